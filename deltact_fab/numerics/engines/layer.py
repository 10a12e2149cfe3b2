"""The bonded layer: its curves (`layer_curves`), its cases (`layer_cases`) and its table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..engine import Engine, EngineTable
from .layer_cases import cases
from .layer_curves import (
    PLACES,
    PUNCH_PERIOD,
    PUNCH_RATIO,
    curves,
    extrapolated_percent,
    punch_error_percent,
    punch_order,
)


def tables(scratch: Path) -> Sequence[EngineTable]:
    """The flat punch, every way of reading it."""
    grids = (128, 256, 512)
    rows = []
    for nu in (0.3, 0.45, 0.5):
        nominal = [round(punch_error_percent(nu, n, False), 3) for n in grids]
        equal = [round(punch_error_percent(nu, n), 3) for n in grids]
        both = [round(extrapolated_percent(nu, n), 3) for n in (256, 512)]
        cells = [round(punch_error_percent(nu, n, cells=True), 3) for n in grids]
        rows.append((nu, *nominal, *equal, round(punch_order(nu, 512), 2), *both, *cells))
    return (
        EngineTable(
            "Flat punch against the Fredholm equation, % of the force",
            f"Radius {PUNCH_RATIO:g} thicknesses, period {PUNCH_PERIOD:g}, mean of {PLACES} places "
            "between the nodes. By nodes one grid of 256 x 256 does not reach 0.5 %: the edge is a "
            "staircase where the pressure is singular, an error of first order. By cells it does; "
            "a sphere, whose gap is curved, is better by nodes, which the contact solver uses.",
            ("nu", *(f"{n}², nominal radius" for n in grids),
             *(f"{n}², equal area" for n in grids), "order", "128² and 256²", "256² and 512²",
             *(f"{n}² cells, equal area" for n in grids)),
            tuple(rows),
        ),
    )  # fmt: skip


ENGINE = Engine(
    "layer",
    "Gel layer",
    "Linear layer bonded to a rigid base, spectral operator, contact by conjugate gradients.",
    curves,
    cases,
    tables,
)
