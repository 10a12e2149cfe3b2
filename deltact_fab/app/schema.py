"""Keys of all files that a lab writes: type, unit, default, limits and meaning, from the models.

Also the columns of measured output."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from deltact_fab.common import (
    InputError,
    did_you_mean,
    json_schema_of,
    resolve_schema,
    toml_literal,
)


@dataclass(frozen=True)
class FileKind:
    """Kind of file. class_path: class that validates it; catalogue: as in `catalog.KINDS`."""

    name: str
    catalogue: str
    about: str
    class_path: str

    def model(self) -> Any:
        """Import and return the class at "module:name" of this package."""
        module, _, name = self.class_path.partition(":")
        return getattr(import_module(f"deltact_fab.{module}"), name)


def _by_name(*kinds: FileKind) -> dict[str, FileKind]:
    return {kind.name: kind for kind in kinds}


_RIG_FOLDER = "protocols/rigs"
FILE_KINDS = _by_name(
    FileKind("protocol", "protocols", "an indentation experiment", "bench.protocols.plan:Protocol"),
    FileKind(
        "virtual-rig",
        _RIG_FOLDER,
        'a simulated bench, kind = "virtual"',
        "bench.rig.config:VirtualConfig",
    ),
    FileKind("grbl-rig", _RIG_FOLDER, 'a real bench, kind = "grbl"', "bench.rig.config:GrblConfig"),
    FileKind("pattern", "patterns", "a pattern sticker", "fabricate.patterns.recipe:PatternRecipe"),
    FileKind(
        "design",
        "cad",
        "the dimensions of a sensor and its tools",
        "fabricate.cad.dimensions:Design",
    ),
    FileKind("indenters", "cad", "a lab's own indenters", "fabricate.cad.design:IndenterList"),
    FileKind(
        "cameras",
        "cad",
        "the cameras that a design can be made for",
        "fabricate.cad.design:CameraList",
    ),
    FileKind(
        "parts", "cad", "suppliers of the items to buy", "fabricate.cad.fabrication.bom:BoughtParts"
    ),
)
_OF_EACH = "that `measure --out` writes for each image"
OUTPUT_KINDS = _by_name(
    FileKind("measured", "", f"columns {_OF_EACH}", "present.live.formatting:MeasuredRow"),
    FileKind("sensor", "sensors", "a sensor's ledger", "bench.record.ledger:SensorLedger"),
    FileKind("fields", "", f"arrays {_OF_EACH}", "present.live.formatting:FieldArrays"),
)
"""Files that the program writes, and a lab may add to."""


def find_kind(name: str) -> FileKind:
    """Return a kind by name. Raises InputError with the nearest name, or all of them."""
    kinds = FILE_KINDS | OUTPUT_KINDS
    if name not in kinds:
        raise InputError(f"no kind of file {name!r}; {did_you_mean(name, kinds)}")
    return kinds[name]


SCHEMA_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_BASE_MEANING = "Base design, a name or a path; its values apply to keys that are not set."
# By suffix of a key's name, longest first: mm_min before min, nmm before mm.
_UNIT_SUFFIXES = {
    "mm_per_px": "mm/px", "per_m": "1/m", "mm_min": "mm/min", "mm_s2": "mm/s2",
    "electrons": "electrons", "nmm": "N mm", "mpa": "MPa", "ohm": "ohm", "deg": "degrees",
    "mm2": "mm2", "mm": "mm", "um": "um", "px": "px", "hz": "Hz", "ms": "ms", "s": "s", "n": "N",
    "k": "K", "v": "V", "baud": "baud", "dpi": "dots per inch",
}  # fmt: skip


def unit_of(key: str) -> str:
    """Return the unit of a key as printed; empty for a key without one."""
    for end, unit in _UNIT_SUFFIXES.items():
        if key.endswith(f"_{end}") or (key == end and len(end) > 2):
            return unit
    return ""


def json_schema(kind: FileKind) -> dict[str, Any]:
    """Return the JSON Schema of a kind, with each key's unit after its meaning."""
    schema = describe(kind)
    for node in (schema, *schema.get("$defs", {}).values()):
        for name, key in node["properties"].items():
            key.pop("instead_of", None)
            if (unit := unit_of(name)) and "description" in key:
                key["description"] += f" [{unit}]"
    return {"$schema": SCHEMA_DIALECT, **schema, "title": f"deltact-fab: {kind.about}"}


def describe(kind: FileKind) -> dict[str, Any]:
    """Return the schema of a kind's model, each meaning one line that ends in a full stop."""
    schema = copy.deepcopy(json_schema_of(kind.model()))
    for node in (schema, *schema.get("$defs", {}).values()):
        if "description" in node:
            node["description"] = _one_line(node["description"].partition("\n\n")[0])
        for key in node["properties"].values():
            assumed = key.pop("unverified", False)
            if "description" in key:
                text = _one_line(key["description"]).rstrip(".") + "."
                key["description"] = f"{text} Assumed, not measured." if assumed else text
    if kind.name == "design":  # `load_design` removes it before validation
        base = {"type": "string", "examples": ["deltact"], "description": _BASE_MEANING}
        schema["properties"] = {"base": base, **schema["properties"]}
    return schema


def _one_line(text: str) -> str:
    plain = " ".join(text.split())
    return plain[:1].upper() + plain[1:]


ONE_TABLE, BY_NAME, MANY_TABLES = "table", "tables by name", "list of tables"
PATH_MARKS = {ONE_TABLE: "", BY_NAME: ".*", MANY_TABLES: "[]"}


@dataclass(frozen=True)
class KeyRow:
    """Description of a key.

    key: its path, such as `capture.settle_s`; `[]` is an entry of a list of tables, `*` any name.
    default, example: TOML literals; None if there is none. The default of an optional table is {},
    and the example of tables by name is a name. instead_of: sibling key that this one replaces.
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
    def default_text(self) -> str:
        """Effect of omitting the key; empty for a table, whose keys have their own."""
        if self.required:
            return "required"
        if self.default == "{}":
            return ""
        return "not set" if self.default is None else f"default {self.default}"


def rows(kind: FileKind) -> list[KeyRow]:
    """Return all keys of a kind: plain keys of a table first, then its tables with their keys."""
    root = describe(kind)
    return list(_rows(root, root, ""))


def _rows(node: dict[str, Any], root: dict[str, Any], prefix: str) -> Iterator[KeyRow]:
    needed = node.get("required", [])
    keys = {name: resolve_schema(key, root) for name, key in node["properties"].items()}
    inner = {name: _inner_table(key, root) for name, key in keys.items()}
    for name in sorted(keys, key=lambda name: inner[name] is not None):
        key, (kind, table) = keys[name], inner[name] or ("", {})
        example = next(iter(key.get("examples", ())), None)
        if kind == BY_NAME and example is not None:
            example = next(iter(example))
        yield KeyRow(
            f"{prefix}{name}",
            kind or type_of(key),
            "" if table else unit_of(name),
            toml_literal(key["default"]) if "default" in key else None,
            name in needed,
            "" if table else limits_of(key),
            key.get("description", ""),
            None if example is None else toml_literal(example),
            key.get("instead_of", ""),
        )
        if table:
            yield from _rows(table, root, f"{prefix}{name}{PATH_MARKS[kind]}.")


def _inner_table(key: dict[str, Any], root: dict[str, Any]) -> tuple[str, dict[str, Any]] | None:
    """Return how a key contains a table, directly or per entry, and that table."""
    entries = key.get("additionalProperties")
    parts = {ONE_TABLE: key, MANY_TABLES: key.get("items"), BY_NAME: entries}
    for kind, part in parts.items():
        if isinstance(part, dict) and "properties" in (table := resolve_schema(part, root)):
            return kind, table
    return None


_TYPE_TEXT = {
    "number": "number", "integer": "whole number", "string": "text", "boolean": "true, false"
}  # fmt: skip


def type_of(key: dict[str, Any]) -> str:
    """Return the type in plain words."""
    if "const" in key:
        return toml_literal(key["const"])
    if "enum" in key:
        return "one of " + ", ".join(map(toml_literal, key["enum"]))
    if "anyOf" in key:
        return " or ".join(dict.fromkeys(map(type_of, key["anyOf"])))
    kind = key.get("type", "any")
    if kind == "array" and "prefixItems" in key:
        kinds = dict.fromkeys(map(_plural_type, key["prefixItems"]))
        return f"list of {len(key['prefixItems'])} {' and '.join(kinds)}"
    if kind == "array":
        return f"list of {_plural_type(key['items'])}"
    if kind == "object":
        entry = key.get("additionalProperties")
        return f"table of {type_of(entry)} by name" if isinstance(entry, dict) else "table"
    return _TYPE_TEXT[kind]


def _plural_type(key: dict[str, Any]) -> str:
    """Return the plural of a type: numbers, lists of numbers; a choice by its values."""
    if "enum" in key:
        return ", ".join(map(toml_literal, key["enum"]))
    first, *remaining = type_of(key).split(" of ", 1)
    return " of ".join([first if first == "true, false" else f"{first}s", *remaining])


def limits_of(key: dict[str, Any]) -> str:
    """Return the limits of a value in plain words."""
    if "anyOf" in key:
        return _join_limits(" or ", key["anyOf"])
    if isinstance(entry := key.get("additionalProperties"), dict):
        return limits_of(entry)
    parts = []
    if key.get("type") == "array":
        if "items" in key:
            count = _bounds(key, "minItems", "maxItems", " entries")
            parts.append(count.replace("st 1 entries", "st 1 entry"))
        inner = _join_limits(" and ", key.get("prefixItems") or [key.get("items", {})])
        parts.append(inner if inner.startswith("each") or not inner else f"each {inner}")
    parts.append(_bounds(key, "minLength", "maxLength", " characters"))
    parts.append(f"matches {key['pattern']}" if "pattern" in key else "")
    parts.append(_bounds(key, "minimum", "maximum", "", "exclusiveMinimum", "exclusiveMaximum"))
    return ", ".join(filter(None, parts))


def _join_limits(separator: str, keys: list[dict[str, Any]]) -> str:
    return separator.join(dict.fromkeys(filter(None, map(limits_of, keys))))


def _bounds(key: dict[str, Any], low: str, high: str, unit: str, *exclusive: str) -> str:
    """Format the range of a value. exclusive: keys of its exclusive limits."""
    lower, upper, above, below = (*map(key.get, (low, high, *exclusive)), None, None)[:4]
    if lower is not None and upper is not None:
        return (
            f"{_number(lower)}" if lower == upper else f"{_number(lower)} to {_number(upper)}"
        ) + unit
    words = {"above": above, "at least": lower, "below": below, "at most": upper}
    return ", ".join(f"{word} {_number(v)}{unit}" for word, v in words.items() if v is not None)


def _number(value: float) -> str:
    return "2^63" if value == 2**63 else f"{value:.12g}"
