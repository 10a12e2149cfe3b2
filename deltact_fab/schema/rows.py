"""One row a key: what a person needs to write it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ..catalog import literal
from ..configuration import resolved
from ..errors import InputError, did_you_mean
from .document import described, unit_of
from .kinds import Kind

TABLE, BY_NAME, MANY = "table", "tables by name", "list of tables"
_MARKS = {TABLE: "", BY_NAME: ".*", MANY: "[]"}


@dataclass(frozen=True)
class KeyRow:
    """One key.

    key: its path, as `capture.settle_s`; `[]` is an entry of a list of tables, `*` any name.
    default, example: as TOML writes them; None where there is none. The default of a table is {}
    where it holds without being written, and the example of tables by name is a name. instead_of:
    the key beside it that is not given where this one is.
    """

    key: str
    type: str
    unit: str
    default: str | None
    required: bool
    limits: str
    meaning: str
    example: str | None = None
    instead_of: str = ""

    @property
    def otherwise(self) -> str:
        """What holds when the key is left out; empty of a table, whose keys say theirs."""
        if self.required:
            return "required"
        if self.default == "{}":
            return ""
        return "not set" if self.default is None else f"default {self.default}"


def rows(kind: Kind) -> list[KeyRow]:
    """Every key of a kind: those of a table, then the tables in it, each above its keys."""
    root = described(kind)
    return list(_rows(root, root, ""))


def matching(kind: Kind, key: str) -> list[KeyRow]:
    """The row of a key and of all below it; or of all keys of that name, wherever they stand.

    Raises InputError naming the nearest key.
    """
    found = rows(kind)
    inside = [row for row in found if row.key == key or row.key.startswith((f"{key}.", f"{key}["))]
    named = inside or [row for row in found if row.key.rpartition(".")[2] == key]
    if not named:
        known = {row.key for row in found} | {row.key.rpartition(".")[2] for row in found}
        hint = did_you_mean(key, known)
        if not hint.startswith("did you mean"):  # hundreds of keys are no hint
            hint = f"`deltact-fab schema {kind.name}` lists all"
        raise InputError(f"schema {kind.name}: {key}: no such key; {hint}")
    return named


def _rows(node: dict[str, Any], root: dict[str, Any], at: str) -> Iterator[KeyRow]:
    needed = node.get("required", [])
    keys = {name: resolved(key, root) for name, key in node["properties"].items()}
    inner = {name: _inner(key, root) for name, key in keys.items()}
    for name in sorted(keys, key=lambda name: inner[name] is not None):
        key, (kind, table) = keys[name], inner[name] or ("", {})
        example = next(iter(key.get("examples", ())), None)
        if kind == BY_NAME and example is not None:
            example = next(iter(example))
        yield KeyRow(
            f"{at}{name}",
            kind or type_of(key),
            "" if table else unit_of(name),
            literal(key["default"]) if "default" in key else None,
            name in needed,
            "" if table else limits_of(key),
            key.get("description", ""),
            None if example is None else literal(example),
            key.get("instead_of", ""),
        )
        if table:
            yield from _rows(table, root, f"{at}{name}{_MARKS[kind]}.")


def _inner(key: dict[str, Any], root: dict[str, Any]) -> tuple[str, dict[str, Any]] | None:
    """How a key holds a table, itself or in each of its entries, and that table."""
    parts = {TABLE: key, MANY: key.get("items"), BY_NAME: key.get("additionalProperties")}
    for kind, part in parts.items():
        if isinstance(part, dict) and "properties" in (table := resolved(part, root)):
            return kind, table
    return None


_TYPES = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true, false"}


def type_of(key: dict[str, Any]) -> str:
    """The type in plain words."""
    if "const" in key:
        return literal(key["const"])
    if "enum" in key:
        return "one of " + ", ".join(map(literal, key["enum"]))
    if "anyOf" in key:
        return " or ".join(dict.fromkeys(map(type_of, key["anyOf"])))
    kind = key.get("type", "any")
    if kind == "array" and "prefixItems" in key:
        kinds = dict.fromkeys(map(_several, key["prefixItems"]))
        return f"list of {len(key['prefixItems'])} {' and '.join(kinds)}"
    if kind == "array":
        return f"list of {_several(key['items'])}"
    if kind == "object":
        entry = key.get("additionalProperties")
        return f"table of {type_of(entry)} by name" if isinstance(entry, dict) else "table"
    return _TYPES[kind]


def _several(key: dict[str, Any]) -> str:
    """The type of entries: numbers, whole numbers, lists of numbers; a choice by its values."""
    if "enum" in key:
        return ", ".join(map(literal, key["enum"]))
    first, *more = type_of(key).split(" of ", 1)
    return " of ".join([first if first == "true, false" else f"{first}s", *more])


def limits_of(key: dict[str, Any]) -> str:
    """What a value may be at least and at most, in plain words."""
    if "anyOf" in key:
        return _each(" or ", key["anyOf"])
    if isinstance(entry := key.get("additionalProperties"), dict):
        return limits_of(entry)
    said = []
    if key.get("type") == "array":
        if "items" in key:
            said.append(
                _range(key, "minItems", "maxItems", " entries").replace(
                    "st 1 entries", "st 1 entry"
                )
            )
        inner = _each(" and ", key.get("prefixItems") or [key.get("items", {})])
        said.append(inner if inner.startswith("each") or not inner else f"each {inner}")
    said.append(_range(key, "minLength", "maxLength", " characters"))
    said.append(f"matches {key['pattern']}" if "pattern" in key else "")
    said.append(_range(key, "minimum", "maximum", "", "exclusiveMinimum", "exclusiveMaximum"))
    return ", ".join(filter(None, said))


def _each(between: str, keys: list[dict[str, Any]]) -> str:
    return between.join(dict.fromkeys(filter(None, map(limits_of, keys))))


def _range(key: dict[str, Any], low: str, high: str, of: str, *beyond: str) -> str:
    """beyond: names of what a value must be above, and below."""
    least, most, above, below = (*map(key.get, (low, high, *beyond)), None, None)[:4]
    if least is not None and most is not None:
        return (
            f"{_number(least)}" if least == most else f"{_number(least)} to {_number(most)}"
        ) + of
    words = {"above": above, "at least": least, "below": below, "at most": most}
    return ", ".join(f"{word} {_number(v)}{of}" for word, v in words.items() if v is not None)


def _number(value: float) -> str:
    return "2^63" if value == 2**63 else f"{value:.12g}"
