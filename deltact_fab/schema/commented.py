"""A TOML file with every key of its kind, each with its meaning, unit and limits above it."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from .document import described, resolved
from .kinds import Kind
from .rows import limits_of, literal, type_of
from .units import unit_of

HOW = (
    'A line that begins with "#" and goes on at once is a key that is not set: its value is what',
    "holds without it, or an example where nothing does. Remove the # and change the value.",
)


def commented(
    kind: Kind,
    given: Mapping[str, Any],
    about: Sequence[str] = (),
    inherited: Mapping[str, Any] | None = None,
    leave_out: Collection[str] = (),
) -> str:
    """The text of a file.

    given: values that are set; inherited: what holds for other keys in place of the model's
    default; leave_out: keys at the top that do not belong into this file. Raises ValueError for a
    required key that is not given.
    """
    root = described(kind)
    head = [f"# {line}".rstrip() for line in (*about, *HOW)]
    body = _table(root, root, "", given, inherited or {}, set(leave_out), off="")
    return "\n".join([*head, *body]) + "\n"


def _table(
    node: dict[str, Any],
    root: dict[str, Any],
    at: str,
    given: Mapping[str, Any],
    inherited: Mapping[str, Any],
    leave_out: set[str],
    off: str,
) -> Iterator[str]:
    needed = [] if off else node.get("required", [])
    tables = []
    for name, raw in node["properties"].items():
        if name in leave_out:
            continue
        key, optional = resolved(raw, root)
        if "properties" in key:
            tables.append((name, key, optional))
            continue
        if name not in given and name in needed:
            raise ValueError(f"{at}{name}: required")
        yield ""
        yield from _note(name, key)
        yield _line(name, key, given, inherited, off)
    for name, key, optional in tables:
        inside = given.get(name, {})
        absent = optional and name not in given
        yield ""
        yield from _wrapped(key.get("description", ""), "## ")
        mark = off or ("#" if absent else "")
        yield f"{mark}[{at}{name}]"
        below = inherited.get(name) or {}
        yield from _table(key, root, f"{at}{name}.", inside, below, set(), mark)


def _line(
    name: str, key: dict[str, Any], given: Mapping[str, Any], inherited: Mapping[str, Any], off: str
) -> str:
    if name in given:
        return f"{off}{name} = {literal(given[name])}"
    if inherited.get(name) is not None:
        return f"#{name} = {literal(inherited[name])}"
    if "default" in key:
        return f"#{name} = {literal(key['default'])}"
    return f"#{name} = {literal(key['examples'][0])}"


def _note(name: str, key: dict[str, Any]) -> Iterator[str]:
    """Meaning, then type, unit and limits in brackets."""
    kind = type_of(key)
    facts = [kind if kind != "number" else "", unit_of(name), limits_of(key)]
    said = "; ".join(fact for fact in facts if fact)
    meaning = key.get("description", "")
    yield from _wrapped(f"{meaning} [{said}]" if said else meaning, "# ")


def _wrapped(text: str, mark: str) -> list[str]:
    return [mark + line for line in textwrap.wrap(text, 96, break_on_hyphens=False)]
