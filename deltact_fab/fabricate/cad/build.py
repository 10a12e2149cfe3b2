"""Build one part: rules first, then the kernel, then the gate; and its cache key."""

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
from .kernel import KERNEL_LIBRARIES, SolidProperties, gate, guarded
from .part import Part
from .registry import find_part


@dataclass(frozen=True)
class BuiltPart(SolidProperties):
    """A part, the design it was built from, and its cadquery Solid in mm."""

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
    """Build one part and gate it; return a cadquery Solid and its properties.

    Raises InputError when a dimension breaks an inequality, before the kernel runs; RunFailed
    naming the part when the kernel fails or returns anything but one valid solid.
    """
    if part.indenter is None:
        feasibility.check_feasible(design)
    return build_from(part, part.source(design))


def build_from(part: Part, source: Any) -> tuple[Any, SolidProperties]:
    """Build from `part.source(design)`, without checking its inequalities again."""
    with guarded(part.name):
        return gate(part.name, part.build(source), part.box(source))


def part_key(part: Part, design: Design) -> dict[str, Any]:
    """Return the cache key of a part: the inputs that `Part.sections` and `Part.derived` declare.

    A test that records every value read verifies that these are all inputs.
    """
    names = () if part.indenter else (*part.sections, *part.derived)
    return {"part": part, **{name: getattr(design, name) for name in names}}


def cad_cache_key(module: str, **inputs: Any) -> dict[str, Any]:
    """Return a cache key: code of the module and of every part, library versions, inputs."""
    files = (
        f"fabricate.cad.parts.{part.name}" for part in pkgutil.iter_modules(parts_package.__path__)
    )
    return cache_key(module, *files, libraries=KERNEL_LIBRARIES, **inputs)
