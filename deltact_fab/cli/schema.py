"""`deltact-fab schema`: the keys of a file, for a person or for an editor."""

from __future__ import annotations

import textwrap
from dataclasses import asdict

import click

from .output import Answer, answers, listed


@click.command(no_args_is_help=False, epilog="Example: deltact-fab schema protocol capture")
@click.argument("kind", required=False)
@click.argument("key", required=False)
@answers
def schema(kind: str | None, key: str | None) -> Answer:
    """Every key of a kind of file: type, unit, default, limits, meaning.

    KIND is protocol, virtual-rig, grbl-rig, pattern, design, indenters, cameras or parts; or
    measured or fields, which `measure --out` writes. Without KIND the kinds are listed. KEY is a
    table such as `capture`, one of its keys such as `capture.settle_s`, or the name of a key in any
    table. --json prints a JSON Schema, or with KEY the rows.
    """
    from ..schema import KINDS, OUTPUTS, document, kind_named, matching, rows

    if kind is None:
        kinds = [(k.name, k.catalogue, k.about) for k in (KINDS | OUTPUTS).values()]
        return listed(("kind", "folder", "about"), kinds)
    found = kind_named(kind)
    chosen = rows(found) if key is None else matching(found, key)
    lines = []
    for row in chosen:
        facts = (row.type, row.unit, row.limits, row.otherwise)
        lines.append(f"{row.key}  ({'; '.join(fact for fact in facts if fact)})")
        lines.append(textwrap.indent(textwrap.fill(row.meaning, 92), "    "))
    return Answer(document(found) if key is None else [asdict(row) for row in chosen], lines)
