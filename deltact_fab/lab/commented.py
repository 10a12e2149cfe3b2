"""A TOML file with every key of its kind, each with its meaning, unit and limits above it."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from ..catalog import literal
from ..schema import BY_NAME, TABLE, KeyRow, Kind, rows

HOW = (
    'A line that begins with "#" and goes on at once is a key that is not set: its value is what',
    "holds without it, or an example where nothing does. Remove the # and change the value.",
)
OR = 'A line that begins with "#or" says the same in another way: one of both is given.'


def commented(
    kind: Kind,
    given: Mapping[str, Any],
    about: Sequence[str] = (),
    inherited: Mapping[str, Any] | None = None,
    leave_out: Collection[str] = (),
    written: Mapping[str, str] | None = None,
) -> str:
    """The text of a file.

    given: values that are set; inherited: what holds for other keys in place of the model's
    default; leave_out: keys at the top that do not belong into this file; written: what stands for
    the value of a key, by its path. A required key that is not given has its example.
    """
    found = [row for row in rows(kind) if row.key.partition(".")[0] not in leave_out]
    ways = (OR,) if any(row.instead_of for row in found) else ()
    lines = [f"# {line}".rstrip() for line in (*about, *HOW, *ways)]
    marks = {"": ""}  # of each table, what stands before its lines
    for row in found:
        table, _, name = row.key.rpartition(".")
        value = _at(given, row.key)
        unset = "" if value is not None or row.required else "#or " if row.instead_of else "#"
        lines.append("")
        if row.type in (TABLE, BY_NAME):
            any_name = row.type == BY_NAME
            mark = max(marks[table], "" if row.default and not any_name else unset, key=len)
            marks[f"{row.key}.*" if any_name else row.key] = mark
            lines += _wrapped(row.meaning, "## ")
            lines.append(f"{mark}[{row.key}.{row.example}]" if any_name else f"{mark}[{row.key}]")
            continue
        if value is None:
            value = _at(inherited or {}, row.key)
        text = (row.default or row.example) if value is None else literal(value)
        text = (written or {}).get(row.key, text)
        lines += _note(row)
        lines.append(f"{max(marks[table], unset, key=len)}{name} = {text}")
    return "\n".join(lines) + "\n"


def _at(data: Any, key: str) -> Any:
    """The value at a path in tables; None where there is none."""
    for name in key.split("."):
        data = data.get(name) if isinstance(data, Mapping) else None
    return data


def _note(row: KeyRow) -> list[str]:
    """Meaning, then type, unit and limits in brackets."""
    facts = (row.type if row.type != "number" else "", row.unit, row.limits)
    said = "; ".join(fact for fact in facts if fact)
    return _wrapped(f"{row.meaning} [{said}]" if said else row.meaning, "# ")


def _wrapped(text: str, mark: str) -> list[str]:
    return [mark + line for line in textwrap.wrap(text, 96, break_on_hyphens=False)]
