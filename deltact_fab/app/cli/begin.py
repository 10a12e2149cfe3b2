"""`deltact-fab init`, `demo`, `doctor`, `schema`: first steps."""

from __future__ import annotations

import textwrap
from dataclasses import asdict
from pathlib import Path

import click

from .options import JSON_OPTION, PATH_TYPE, out_folder, seed
from .output import Answer, answers, compact, echo_json, listing, progress


@click.command(epilog="Example: deltact-fab init my-lab")
@click.argument("folder", type=PATH_TYPE)
@answers
def init(folder: Path) -> Answer:
    """Make a working folder with files of your own.

    FOLDER, which must be new or empty, gets the shipped designs, patterns, protocols and rigs,
    schemas for an editor, and a README with a first tour. Commands that run inside it prefer its
    files.
    """
    from ..lab import init as write

    files = write(folder)
    summary = f"{folder}: {len(files)} files written; `cd {folder}`, then see README.md"
    return Answer([str(file) for file in files], [summary])


@click.command()
@out_folder("Folder to write; that of an earlier demo is replaced.", default=Path("demo-out"))
@seed("Seed of all random numbers.", 3)
@JSON_OPTION
def demo(out: Path, seed: int, as_json: bool) -> None:
    """Run the whole chain once: parts, pattern, calibration, a virtual experiment, its report."""
    from .. import demo as chain

    lines: list[str] = []
    page = chain.run(out, seed, progress, lines.append if as_json else click.echo)
    if as_json:
        echo_json({"file": str(page), "seed": seed, "lines": lines})


@click.command()
@answers
def doctor() -> Answer:
    """Report what is installed, and for each missing item its purpose and how to install it.

    Checks Python, the packages of the core and of each extra, and system libraries. Nothing is
    opened or changed. Exit code 1 if the core is broken.
    """
    from ..doctor import inspect_installation, is_broken

    findings = inspect_installation()
    broken = is_broken(findings)
    absent = sum(f.state != "ok" for f in findings)
    verdict = f"Core {'broken' if broken else 'OK'}. {absent} items missing."
    data = {"ok": not broken, "findings": [asdict(f) for f in findings]}
    lines = [(f.state, f.group, f.name, f.text, f.brings, f.get) for f in findings]
    item_lines = compact(("", "part of", "name", "found", "for", "how to install"), lines)
    return Answer(data, [*item_lines, verdict], "" if broken else None)


@click.command(no_args_is_help=False, epilog="Example: deltact-fab schema protocol")
@click.argument("kind", required=False)
@answers
def schema(kind: str | None) -> Answer:
    """List the keys of a kind of file: type, unit, default, limits, meaning.

    KIND is protocol, virtual-rig, grbl-rig, pattern, design, indenters, cameras or parts; sensor,
    which `rig sensors` lists; or measured or fields, which `measure --out` writes. Without KIND the
    kinds are listed. --json prints a JSON Schema.
    """
    from ..schema import FILE_KINDS, OUTPUT_KINDS, find_kind, json_schema, rows

    if kind is None:
        kinds = [(k.name, k.catalogue, k.about) for k in (FILE_KINDS | OUTPUT_KINDS).values()]
        return listing(("kind", "folder", "about"), kinds)
    file_kind = find_kind(kind)
    lines = []
    for row in rows(file_kind):
        facts = (row.type, row.unit, row.limits, row.default_text)
        lines.append(f"{row.key}  ({'; '.join(fact for fact in facts if fact)})")
        lines.append(textwrap.indent(textwrap.fill(row.meaning, 92), "    "))
    return Answer(json_schema(file_kind), lines)
