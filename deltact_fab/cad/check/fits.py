"""Whether parts go together at the limits of what made them, and onto the printer's platform.

Arithmetic on dimensions: no solid is built, so that these rows are there however much else fails.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..dimensions import Design
from ..part import PRINT
from ..registry import of_design
from .row import Row

NAME = "fit at its limits"
BED = "fits the printer"


def rows(design: Design) -> Iterator[Row]:
    """Each mating pair: least and most play, every length at its worst."""
    for part in of_design(design):
        for fit in part.fits(design):
            low, high = fit.range_mm
            limit = f">= {fit.least_mm:g} mm"
            found = f"{fit.name}: {round(low, 3) + 0.0:.3f} to {high:.3f} mm"
            left = low - fit.least_mm
            yield Row(NAME, fit.parts, found, limit, fit.holds, fit.rests_on, left)


def platform(design: Design) -> Iterator[Row]:
    """The printed part that leaves least room, as it lies or turned by a right angle in plan."""
    printer = design.resin_printer
    room = [*sorted((printer.bed_x_mm, printer.bed_y_mm), reverse=True), printer.bed_z_mm]
    sides = {}
    for part in of_design(design):
        if part.process == PRINT:
            low, high = part.box(part.source(design))
            x, y, z = part.lies.size_mm(low, high)
            sides[part.name] = [max(x, y), min(x, y), z]
    left = {
        name: min(r - s for r, s in zip(room, size, strict=True)) for name, size in sides.items()
    }
    keys = tuple(f"resin_printer.bed_{axis}_mm" for axis in "xyz")
    limit = f"<= {_by(room)} mm (resin_printer.bed_x_mm, bed_y_mm, bed_z_mm)"
    tight = [name for name in left if left[name] < 0] or [min(left, key=lambda name: left[name])]
    for name in tight:
        yield Row(BED, name, f"{_by(sides[name])} mm", limit, left[name] >= 0, keys)


def _by(sides_mm: list[float]) -> str:
    return " x ".join(f"{side:.4g}" for side in sides_mm)
