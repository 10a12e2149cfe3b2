"""Solids that tests read: each built once in a process, simple ones, and a design with others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.check.built import BuiltDesign
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.kernel import require


@cache
def made(name: str, design: str = "deltact", *changes: str) -> Any:
    """The gated solid of a part."""
    return build_part(registry.find_part(name), load_design(design, changes))[0]


def of_group(group: str) -> dict[str, Any]:
    """Every part of a group of the default design."""
    return {part.name: made(part.name) for part in registry.parts_of_group(group)}


def box(low, high):
    """A cuboid between two corners."""
    size = [b - a for a, b in zip(low, high, strict=True)]
    return require().Solid.makeBox(*size, require().Vector(*low))


def rod(radius, low_z, high_z, x=0.0, y=0.0):
    """A cylinder along z."""
    cq = require()
    return cq.Solid.makeCylinder(radius, high_z - low_z, cq.Vector(x, y, low_z), cq.Vector(0, 0, 1))


def moved(solid, x, y, z):
    return solid.moved(require().Location((x, y, z)))


def common_mm3(a, b):
    """The volume that two solids share."""
    return a.intersect(b).Volume()


def mutated(built: BuiltDesign, solids: Mapping[str, Any]) -> BuiltDesign:
    """A built design with other solids; it looks for nothing in the user's cache."""
    return replace(
        built,
        facts=None,
        solids={**built.solids, **solids},
        meshes={name: mesh for name, mesh in built.meshes.items() if name not in solids},
        results={key: r for key, r in built.results.items() if not {*key[1]} & {*solids}},
        features_of={n: seen for n, seen in built.features_of.items() if n not in solids},
    )
