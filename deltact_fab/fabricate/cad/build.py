"""One part to one gated solid: rules first, then the kernel, then the gate; and its key."""

from __future__ import annotations

import pkgutil
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from deltact_fab.common import cache_key

from . import feasibility
from . import parts as parts_package
from .design import load_design
from .dimensions import Design
from .kernel import LIBRARIES, SolidProperties, gate, guarded
from .part import Part
from .registry import find_part


@dataclass(frozen=True)
class BuiltPart(SolidProperties):
    """A part, the design that it was built of, and its cadquery Solid in mm."""

    part: Part
    design: Design
    solid: Any


def build_named_part(name: str, design: str = "deltact", changes: Iterable[str] = ()) -> BuiltPart:
    """Build a part of a design, both by name ("skin", "indenter-sphere-10"); a design also by path.

    changes: of the design, as in "skin.thickness_mm=14". Raises as `find`, `load_design` and
    `build_part` do.
    """
    part, sizes = find_part(name), load_design(design, changes)
    solid, measured = build_part(part, sizes)
    return BuiltPart(**vars(measured), part=part, design=sizes, solid=solid)


def build_part(part: Part, design: Design) -> tuple[Any, SolidProperties]:
    """Build one part and gate it: a cadquery Solid and its measures.

    Raises InputError when a dimension breaks an inequality, before the kernel runs; RunFailed
    naming the part when the kernel fails or returns something else.
    """
    if part.indenter is None:
        feasibility.check_feasible(design)
    return build_from(part, part.source(design))


def build_from(part: Part, source: Any) -> tuple[Any, SolidProperties]:
    """The same from what `part.source` gives, whose inequalities hold already."""
    with guarded(part.name):
        return gate(part.name, part.build(source), part.box(source))


def part_key(part: Part, design: Design) -> dict[str, Any]:
    """The one key of a part: what its solid is made from, as `Part.sections` and
    `Part.derived` declare it.

    That this is all is held by a test which notes every value read.
    """
    inputs = (
        {} if part.indenter else {n: getattr(design, n) for n in (*part.sections, *part.derived)}
    )
    return {"part": part, **inputs}


def cad_cache_key(module: str, **inputs: Any) -> dict[str, Any]:
    """A key of the cache: all code of a module and of every part, the libraries, what is given."""
    files = (
        f"fabricate.cad.parts.{part.name}" for part in pkgutil.iter_modules(parts_package.__path__)
    )
    return cache_key(module, *files, libraries=LIBRARIES, **inputs)
