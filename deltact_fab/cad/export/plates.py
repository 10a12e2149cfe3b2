"""Printed parts arranged on the printer's platform: which plate, and where. No CAD kernel.

A plate is of one resin. Parts stand in rows by depth, the deepest first: with some twenty parts
nothing cleverer saves a plate.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from ...errors import InputError
from ..dimensions import Design
from ..part import Part

GAP_MM = 4.0  # between parts, for supports and a scraper
EDGE_MM = 2.0


def bed_mm(design: Design) -> tuple[float, float]:
    """Sides of the platform (x, y)."""
    return design.resin_printer.bed_x_mm, design.resin_printer.bed_y_mm


@dataclass(frozen=True)
class PlatePlacement:
    """One piece: the middle of its place from the platform's front left corner."""

    part: Part
    x_mm: float
    y_mm: float


@dataclass
class PrintPlate:
    """What is printed at once, of one material."""

    material: str
    pieces: list[PlatePlacement] = field(default_factory=list)


@dataclass
class _Row:
    y_mm: float
    deep_mm: float
    x_mm: float = EDGE_MM


def arranged(design: Design, parts: Iterable[Part]) -> list[PrintPlate]:
    """Every printed piece of the parts on plates; the order of the parts does not count.

    Raises InputError naming a part that is larger than the platform.
    """
    sized = sorted(
        ((part, *_footprint_mm(design, part)) for part in parts if part.printed),
        key=lambda e: (e[0].material, -e[2], -e[1], e[0].name),
    )
    plates: list[PrintPlate] = []
    rows: list[_Row] = []
    for part, wide_mm, deep_mm in sized:
        for _ in range(part.quantity):
            if not plates or plates[-1].material != part.material:
                plates.append(PrintPlate(part.material))
                rows = []
            row = _room(rows, wide_mm, deep_mm, bed_mm(design))
            if row is None:
                plates.append(PrintPlate(part.material))
                rows = []
                row = _room(rows, wide_mm, deep_mm, bed_mm(design))
            assert row is not None
            middle = (row.x_mm + wide_mm / 2, row.y_mm + deep_mm / 2)
            plates[-1].pieces.append(PlatePlacement(part, *middle))
            row.x_mm += wide_mm + GAP_MM
    return plates


def _footprint_mm(design: Design, part: Part) -> tuple[float, float]:
    """Sides of its box on the platform; of a tilted part an upper bound."""
    wide_mm, deep_mm, _ = part.lies.size_mm(*part.box(part.source(design)))
    bed = bed_mm(design)
    room_x_mm, room_y_mm = (side - 2 * EDGE_MM for side in bed)
    if wide_mm > room_x_mm or deep_mm > room_y_mm:
        raise InputError(
            f"{part.name}: {wide_mm:.1f} x {deep_mm:.1f} mm as it is printed; the platform of "
            f"{bed[0]:g} x {bed[1]:g} mm holds {room_x_mm:g} x {room_y_mm:g} mm: set "
            "resin_printer.bed_x_mm, bed_y_mm, or leave out the format 3mf"
        )
    return wide_mm, deep_mm


def _room(
    rows: list[_Row], wide_mm: float, deep_mm: float, bed: tuple[float, float]
) -> _Row | None:
    """The first row that has room, or a new one behind the others; None when the plate is full."""
    for row in rows:
        if deep_mm <= row.deep_mm and row.x_mm + wide_mm <= bed[0] - EDGE_MM:
            return row
    y_mm = rows[-1].y_mm + rows[-1].deep_mm + GAP_MM if rows else EDGE_MM
    if y_mm + deep_mm > bed[1] - EDGE_MM:
        return None
    rows.append(_Row(y_mm, deep_mm))
    return rows[-1]
