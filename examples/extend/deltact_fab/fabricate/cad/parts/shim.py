"""Shim for the bench, as thick as a wall of the housing, for setting the height of a stage."""

from __future__ import annotations

from collections.abc import Iterable

from deltact_fab.common import Check

from ..dimensions import Design
from ..drafting.dimensioning import Callouts
from ..kernel import Extent, Shape, require
from ..part import RESIN_MATERIAL, Part
from ..rule import at_most


def size(d: Design) -> tuple[float, float, float]:
    """Sides in mm."""
    return 20.0, 30.0, d.shell.wall_mm


def box(d: Design) -> Extent:
    """Expected bounding box of the solid."""
    return (0.0, 0.0, 0.0), size(d)


def build(d: Design) -> Shape:
    """Build the solid."""
    return require().Solid.makeBox(*size(d))


def rules(d: Design) -> Iterable[Check]:
    """Rule of the smallest printable thickness."""
    yield at_most("thick", "1", 1.0, "shell.wall_mm", d.shell.wall_mm)


def callouts(d: Design) -> Callouts:
    """Drawing content besides the lengths, which are read off the solid."""
    return Callouts(notes=("Flat.",))


def note(d: Design) -> str:
    """Note in the bill of materials."""
    return f"{d.shell.wall_mm:g} mm thick"


PARTS = (
    Part(
        "shim",
        build,
        box,
        material=RESIN_MATERIAL,
        group="bench",
        sections=("shell",),
        derived=("z_joint_mm",),
        rules=rules,
        wall_keys=("shell.wall_mm",),
        callouts=callouts,
        note=note,
        how="flat on the platform",
        look_for="no warp",
    ),
)
