"""One row a key: what a person needs to write it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from ..errors import InputError, did_you_mean
from .document import described, resolved
from .kinds import Kind
from .units import unit_of


@dataclass(frozen=True)
class KeyRow:
    """One key.

    key: its path, as `capture.settle_s`; `[]` is an entry of a list of tables, `*` any name.
    default: as TOML writes it; None where the key has no value unless one is given.
    """

    key: str
    type: str
    unit: str
    default: str | None
    required: bool
    limits: str
    meaning: str

    def as_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return asdict(self)

    @property
    def otherwise(self) -> str:
        """What holds when the key is left out."""
        if self.required:
            return "required"
        if self.type == "table":
            return ""
        return self.default if self.default is not None else "not set"


def rows(kind: Kind) -> list[KeyRow]:
    """Every key of a kind, tables above the keys inside them."""
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
    for name, raw in node["properties"].items():
        key, _ = resolved(raw, root)
        path = f"{at}{name}"
        inner, mark = _inner(key, root)
        meaning = key.get("description", "")
        default = None if inner or "default" not in key else literal(key["default"])
        kind = {"": "table", "[]": "list of tables", ".*": "tables by name"}[mark]
        yield KeyRow(
            path,
            kind if inner else type_of(key),
            "" if inner else unit_of(name),
            default,
            name in needed,
            "" if inner else limits_of(key),
            meaning,
        )
        if inner:
            yield from _rows(inner, root, f"{path}{mark}.")


def _inner(key: dict[str, Any], root: dict[str, Any]) -> tuple[dict[str, Any] | None, str]:
    """The table that a key is, or that each entry of it is, and how its path says so."""
    if "properties" in key:
        return key, ""
    for part, mark in (("items", "[]"), ("additionalProperties", ".*")):
        if isinstance(key.get(part), dict):
            entry, _ = resolved(key[part], root)
            if "properties" in entry:
                return entry, mark
    return None, ""


def literal(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, dict):
        inner = ", ".join(f"{name} = {literal(one)}" for name, one in value.items())
        return f"{{{inner}}}"
    return json.dumps(value, ensure_ascii=False)


_TYPES = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true, false"}
_MANY = {"number": "numbers", "integer": "whole numbers", "string": "texts"}


def type_of(key: dict[str, Any]) -> str:
    """The type in plain words."""
    if "const" in key:
        return literal(key["const"])
    if "enum" in key:
        return "one of " + ", ".join(map(literal, key["enum"]))
    if "anyOf" in key:
        return " or ".join(dict.fromkeys(map(type_of, key["anyOf"])))
    kind = key.get("type", "any")
    if kind == "array":
        return f"list of {_entries(key)}"
    if kind == "object":
        entry = key.get("additionalProperties")
        return f"table of {type_of(entry)} by name" if isinstance(entry, dict) else "table"
    return _TYPES[kind]


def _entries(key: dict[str, Any]) -> str:
    if "prefixItems" in key:
        parts = key["prefixItems"]
        kinds = {part.get("type") for part in parts}
        return f"{len(parts)} {_MANY[kinds.pop()]}" if len(kinds) == 1 else "values"
    item = key["items"]
    if "enum" in item:
        return ", ".join(map(literal, item["enum"]))
    if item.get("type") == "array":
        return f"lists of {_entries(item)}"
    return _MANY.get(item.get("type", ""), type_of(item))


def limits_of(key: dict[str, Any]) -> str:
    """What a value may be at least and at most, in plain words."""
    if "anyOf" in key:
        return " or ".join(dict.fromkeys(filter(None, map(limits_of, key["anyOf"]))))
    if "additionalProperties" in key and isinstance(key["additionalProperties"], dict):
        return limits_of(key["additionalProperties"])
    said = []
    if key.get("type") == "array":
        parts = key.get("prefixItems") or [key.get("items", {})]
        inner = list(dict.fromkeys(filter(None, map(limits_of, parts))))
        if "prefixItems" not in key and (count := _range(key, "minItems", "maxItems")):
            said.append(f"{count} {'entry' if count.endswith(' 1') else 'entries'}")
        if inner:
            each = "" if inner[0].startswith("each") else "each "
            said.append(each + (inner[0] if len(inner) == 1 else " and ".join(inner)))
    if key.get("type") == "string" and (count := _range(key, "minLength", "maxLength")):
        said.append(f"{count} characters")
    if "pattern" in key:
        said.append(f"matches {key['pattern']}")
    if value := _range(key, "minimum", "maximum"):
        said.append(value)
    return ", ".join(said)


def _range(key: dict[str, Any], low: str, high: str) -> str:
    above, below = key.get("exclusiveMinimum"), key.get("exclusiveMaximum")
    least, most = key.get(low), key.get(high)
    if low != "minimum":
        above = below = None
    if least is not None and most is not None:
        return f"{_number(least)}" if least == most else f"{_number(least)} to {_number(most)}"
    parts = [
        (above, "above"), (least, "at least"), (below, "below"), (most, "at most")
    ]  # fmt: skip
    return ", ".join(f"{word} {_number(value)}" for value, word in parts if value is not None)


def _number(value: float) -> str:
    if isinstance(value, int) and value.bit_length() > 40 and value & (value - 1) == 0:
        return f"2^{value.bit_length() - 1}"
    return f"{value:.12g}"
