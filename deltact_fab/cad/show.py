"""What a part is made from: its dimensions, what follows from them, its rules. No CAD kernel."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from . import feasibility
from .design import IndenterDimensions
from .dimensions import Design
from .part import Part
from .rule import Rule


@dataclass(frozen=True)
class Dimension:
    """One independent value. low, high: what it accepts; None where it is no bounded number."""

    key: str
    value: Any
    meaning: str
    low: float | None = None
    high: float | None = None
    unverified: bool = False


@dataclass(frozen=True)
class Derived:
    """One derived value with its equation in words."""

    key: str
    value: Any
    equation: str


@dataclass(frozen=True)
class RuleLine:
    """One inequality with its numbers. margin: right less left, None where that is no number."""

    text: str
    holds: bool
    margin: float | None
    rests_on: tuple[str, ...]


@dataclass(frozen=True)
class Description:
    """A part as `cad show` prints it."""

    name: str
    group: str
    number: int
    material: str
    process: str
    quantity: int
    dimensions: tuple[Dimension, ...]
    derived: tuple[Derived, ...]
    rules: tuple[RuleLine, ...]

    def tables(self) -> list[tuple[str, tuple[str, ...], list[tuple[Any, ...]]]]:
        """What `cad show` prints: (title, columns, rows) of each table that is not empty."""
        about = [(self.name, self.material, self.process, self.quantity)]
        given = [
            (
                d.key + (" (unverified)" if d.unverified else ""),
                shown(d.value),
                "" if d.low is None else f"{d.low:g} to {d.high:g}",
                d.meaning,
            )
            for d in self.dimensions
        ]
        derived = [(d.key, shown(d.value), d.equation) for d in self.derived]
        rules = [(r.text, "holds" if r.holds else "FAILS", r.margin) for r in self.rules]
        every: list[tuple[str, tuple[str, ...], list[tuple[Any, ...]]]] = [
            ("", ("part", "material", "process", "quantity"), list(about)),
            ("Dimensions", ("key", "value", "limits", "meaning"), list(given)),
            ("Derived", ("key", "value", "equation"), list(derived)),
            ("Rules", ("inequality", "verdict", "margin"), list(rules)),
        ]
        return [table for table in every if table[2]]


def describe(part: Part, design: Design) -> Description:
    """Everything that decides the part, also where a rule is broken: that is when one looks."""
    if part.indenter is not None:
        given, derived = _of_indenter(part.indenter)
        rules: list[Rule] = []
    else:
        records = {section: getattr(design, section) for section in part.sections}
        given, derived = _of_records(records, design.unverified())
        known = dict(properties(type(design)))
        derived += [Derived(name, getattr(design, name), known[name]) for name in part.derived]
        names = (part.name, *part.bound_by)
        rules = [rule for rule in feasibility.rules(design) if rule.part in names]
    margins = [rule.right.value - rule.left.value for rule in rules]
    lines = [
        RuleLine(rule.text, rule.holds, margin if math.isfinite(margin) else None, rule.rests_on)
        for rule, margin in zip(rules, margins, strict=True)
    ]
    about = (part.name, part.group, part.number, part.material, part.process, part.quantity)
    return Description(*about, tuple(given), tuple(derived), tuple(lines))


def shown(value: Any) -> str:
    """A value for a table: numbers with six digits, pairs in brackets."""
    if isinstance(value, tuple | list):
        return f"({', '.join(shown(v) for v in value)})"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _of_records(
    records: dict[str, Any], unverified: Sequence[str]
) -> tuple[list[Dimension], list[Derived]]:
    """Fields and properties of a design's sections, by name."""
    given: list[Dimension] = []
    derived: list[Derived] = []
    for section, record in records.items():
        for f in fields(record):
            key, meta = f"{section}.{f.name}", f.metadata
            about = (meta.get("description", ""), meta.get("ge"), meta.get("le"), key in unverified)
            given.append(Dimension(key, getattr(record, f.name), *about))
        for name, equation in properties(type(record)):
            value, key = getattr(record, name), f"{section}.{name}"
            if not is_dataclass(value):
                derived.append(Derived(key, value, equation))
                continue
            for f in fields(value):
                row = (f"{key}.{f.name}", getattr(value, f.name), "table of standards")
                derived.append(Derived(*row))
    return given, derived


def properties(record: type) -> list[tuple[str, str]]:
    """Properties of a class with their equations: base classes first, in the source's order."""
    found: dict[str, str] = {}
    for kind in reversed(record.__mro__):
        for name, member in vars(kind).items():
            if isinstance(member, property) and not name.startswith("_"):
                found[name] = equation(inspect.getdoc(member) or "")
    return list(found.items())


def equation(docstring: str) -> str:
    """The first line of a docstring without the values it has by default.

    `Length of strip = count x pitch: 83.3.` is `Length of strip = count x pitch`.
    """
    line = docstring.split("\n", 1)[0].strip()
    line = re.sub(r": [-+(]*\d[^:]*$", "", line)
    return re.sub(r" = -?[\d.]+(?=,|\.?$)", "", line).rstrip(".")


def _of_indenter(dims: IndenterDimensions) -> tuple[list[Dimension], list[Derived]]:
    shape = dims.indenter
    lengths = (
        ("plate_mm", dims.body.plate_mm, "back plate"),
        ("stem_diameter_mm", shape.stem_diameter_mm, "stem, for the stage's tool holder"),
        ("stem_length_mm", shape.stem_length_mm, "stem above the plate"),
        ("reach_mm", shape.reach_mm, "free length of the tips below the plate"),
    )
    given = [Dimension(*length) for length in lengths]
    derived: list[Derived] = []
    for i, tip in enumerate(shape.tips, 1):
        label = f"tip{i}" if len(shape.tips) > 1 else "tip"
        told = f"{type(tip).__name__.removesuffix('Tip').lower()}: "
        for f in fields(tip):
            value = _flat(getattr(tip, f.name))
            given.append(Dimension(f"{label}.{f.name}", value, told + _TOLD[f.name]))
        for key, text in properties(type(tip)):
            if key not in {f.name for f in fields(tip)} and not is_dataclass(getattr(tip, key)):
                derived.append(Derived(f"{label}.{key}", getattr(tip, key), text or _OF_ALL[key]))
    for key, text in properties(type(shape)):
        if key != "slug":
            derived.append(Derived(key, getattr(shape, key), text))
    whole = dims.plate_z_mm + dims.body.plate_mm + shape.stem_length_mm
    derived.append(Derived("plate_z_mm", dims.plate_z_mm, "Underside of the plate = reach"))
    derived.append(Derived("height_mm", whole, "Whole height = reach + plate + stem"))
    return given, derived


def _flat(value: Any) -> Any:
    """The pieces of a turned profile as (end, centre of the arc), everything else as it is."""
    if isinstance(value, tuple):
        return tuple(tuple(vars(v).values()) if is_dataclass(v) else v for v in value)
    return value


# What every tip states, and what the fields of each are.
_OF_ALL = {
    "lowest_mm": "(x, y) of a lowest point",
    "radius_mm": "Radius of a ball that fits inside and touches a lowest point",
    "equator_mm": "Height at which its sides turn vertical",
    "half_mm": "Half sides (x, y) of the box around it",
    "corner_mm": "Smallest convex radius of its outline",
}
_TOLD = {
    "x_mm": "where it stands in the indenter's frame",
    "y_mm": "where it stands in the indenter's frame",
    "corner_mm": "rounding of its points",
    "notch_mm": "rounding of its notches",
    "edge_mm": "rounding of its face",
    "points": "number of points",
    "outer_mm": "from the middle to the end of a rounded point",
    "inner_mm": "from the middle to where two sides would meet if the notch were not rounded",
    "a_mm": "semi-axis along x",
    "b_mm": "semi-axis along y and z",
    "radius_mm": "a ball of this radius fits inside the tip and touches it at its lowest point",
    "half_width_mm": "half the width, where the sides turn vertical",
    "length_mm": "straight part along y",
    "flank_deg": "angle of the flanks with the vertical",
    "start_mm": "innermost point (d, z) of the profile",
    "pieces": "the profile from there: (end, centre of an arc)",
}
