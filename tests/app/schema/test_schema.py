"""Rows and JSON Schemas tell what the models do: meanings, limits, defaults."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from deltact_fab.app.lab import kind_of
from deltact_fab.app.schema import (
    FILE_KINDS,
    OUTPUT_KINDS,
    FileKind,
    describe,
    json_schema,
    limits_of,
    rows,
    type_of,
    unit_of,
)
from deltact_fab.common import catalog
from deltact_fab.common.configuration import resolve_schema
from deltact_fab.common.errors import InputError
from deltact_fab.paths import shipped_folder

EXAMPLES = {
    "protocol": "smoke",
    "virtual-rig": "virtual",
    "grbl-rig": "grbl-bench",
    "pattern": "dense-with-dots",
    "design": "deltact",
    "indenters": "indenters",
    "cameras": "cameras",
    "parts": "parts",
}
ALL = pytest.mark.parametrize("kind", FILE_KINDS.values(), ids=lambda kind: kind.name)


def shipped(kind: FileKind) -> Iterator[tuple[Path, dict[str, Any]]]:
    for file in sorted(shipped_folder(kind.catalogue).glob("*.toml")):
        data = catalog.read_toml(file)
        if kind_of(kind.catalogue, data) == kind.name:
            yield file, data


@pytest.mark.parametrize("kind", (FILE_KINDS | OUTPUT_KINDS).values(), ids=lambda kind: kind.name)
def test_every_key_says_what_it_means(kind: FileKind) -> None:
    found = rows(kind)
    assert len(found) >= 5
    assert [row.key for row in found if len(row.meaning) < 8] == []
    assert len({row.key for row in found}) == len(found)


@ALL
def test_shipped_files_pass_other_schema_validator(kind: FileKind) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    made = json_schema(kind)
    jsonschema.Draft202012Validator.check_schema(made)
    reader = jsonschema.Draft202012Validator(made)
    for file, data in shipped(kind):
        assert [fault.message for fault in reader.iter_errors(data)] == [], file.name
        assert list(reader.iter_errors({**data, "no_such_key": 1})), file.name


@dataclass(frozen=True)
class Number:
    """A key that is one number, with its path and its own schema."""

    path: tuple[str, ...]
    key: dict[str, Any]


def numbers(node: dict[str, Any], root: dict[str, Any], at: tuple[str, ...]) -> Iterator[Number]:
    for name, raw in node["properties"].items():
        key = resolve_schema(raw, root)
        if "properties" in key:
            yield from numbers(key, root, (*at, name))
        elif key.get("type") in ("number", "integer") and "enum" not in key:
            yield Number((*at, name), key)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, id=kind.name, marks=[pytest.mark.slow] * (kind.name == "design"))
        for kind in FILE_KINDS.values()
        if kind.name not in ("cameras", "parts")  # a camera's are a design's; parts have none
    ],
)
def test_model_refuses_number_beyond_limits(kind: FileKind) -> None:
    """The limits of the schema are those of the model: else an editor and `check` disagree."""
    start = catalog.read_toml(catalog.find_file(kind.catalogue, EXAMPLES[kind.name]))
    root = describe(kind)
    tried = 0
    for number in numbers(root, root, ()):
        least = number.key.get("minimum", number.key.get("exclusiveMinimum"))
        most = number.key.get("maximum", number.key.get("exclusiveMaximum"))
        assert least is not None, number.path
        assert most is not None, number.path
        step = 1 if number.key["type"] == "integer" else 1e-6
        for value in (least - max(1, abs(least)) * step, most + max(1, abs(most)) * step):
            data = copy.deepcopy(start)
            table = data
            for name in number.path[:-1]:
                table = table.setdefault(name, {})
            table[number.path[-1]] = int(value) if number.key["type"] == "integer" else value
            with pytest.raises(InputError) as caught:
                catalog.validate(kind.model(), data, "f")
            assert number.path[-1] in str(caught.value), number.path
            tried += 1
    assert tried >= 2


@ALL
def test_defaults_are_those_of_the_model(kind: FileKind) -> None:
    """With every default of its rows written out, a file is the same to the model."""
    start = catalog.read_toml(catalog.find_file(kind.catalogue, EXAMPLES[kind.name]))
    start.pop("base", None)
    adapter = TypeAdapter(kind.model())
    plain = adapter.dump_python(catalog.validate(kind.model(), start, "f"), mode="json")
    full = copy.deepcopy(start)
    for row in rows(kind):
        *tables, name = row.key.split(".")
        if row.default is None or "[]" in row.key or "*" in row.key:
            continue
        held, at = plain, full
        for table in tables:
            held = held.get(table) if isinstance(held, dict) else None
            at = at.setdefault(table, {}) if held is not None else {}
        if name not in at:
            at[name] = json.loads(row.default)
    again = adapter.dump_python(catalog.validate(kind.model(), full, "f"), mode="json")
    assert again == plain


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ({"type": "number", "minimum": 0, "exclusiveMaximum": 1},
         ("number", "at least 0, below 1")),
        ({"type": "array", "items": {"enum": ["x", "y"]}, "minItems": 1},
         ('list of "x", "y"', "at least 1 entry")),
        ({"type": "array", "prefixItems": [{"type": "number", "maximum": 5}] * 2},
         ("list of 2 numbers", "each at most 5")),
        ({"anyOf": [{"type": "integer"}, {"type": "string", "minLength": 1, "maxLength": 9}]},
         ("whole number or text", "1 to 9 characters")),
    ],
)  # fmt: skip
def test_types_and_limits_in_plain_words(key: dict[str, Any], says: tuple[str, str]) -> None:
    assert (type_of(key), limits_of(key)) == says


@pytest.mark.parametrize(
    ("key", "unit"),
    [("press_feed_mm_min", "mm/min"), ("range_nmm", "N mm"), ("mm_per_px", "mm/px"),
     ("settle_s", "s"), ("poisson", ""), ("axes", ""), ("force_n", "N"), ("positions_mm", "mm")],
)  # fmt: skip
def test_unit_is_name_suffix(key: str, unit: str) -> None:
    assert unit_of(key) == unit
