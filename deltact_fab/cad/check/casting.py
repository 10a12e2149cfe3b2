"""The mold: what it holds with a frame in it is one skin."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..kernel import require
from ..parts.mold import centres_mm
from ..solid_gate import VOLUME_TOLERANCE, bounding_box
from .built import BuiltDesign
from .row import Row


def closure(built: BuiltDesign) -> Iterator[Row]:
    """V(cavity) + V(the frame's window in front of the ledge) = V(skin), by filling the mold."""

    def filled() -> tuple[float, list[float]]:
        held = [_held_mm3(built, frame, at) for frame, at in _seated(built)]
        return float(built.solid("skin").Volume()), held

    skin_mm3, held = built.fact("held", ("mold", "skin-frame", "skin"), filled)
    worst = max(held, key=lambda v: abs(v - skin_mm3))
    yield Row(
        "mold volume closure",
        "mold, skin-frame, skin",
        f"{worst:.3f} mm3, the skin {skin_mm3:.3f} ({len(held)} cavities)",
        f"within {VOLUME_TOLERANCE:g} of the skin",
        abs(worst - skin_mm3) <= VOLUME_TOLERANCE * skin_mm3,
    )


def _seated(built: BuiltDesign) -> list[tuple[Any, tuple[float, float]]]:
    """The frame, turned half about x, in each of the mold's seats."""
    cq = require()
    turned = built.solid("skin-frame").rotate(cq.Vector(), cq.Vector(1, 0, 0), 180)
    base_mm = built.design.mold.base_mm
    return [
        (turned.moved(cq.Location((x, y, base_mm))), (x, y)) for x, y in centres_mm(built.design)
    ]


def _held_mm3(built: BuiltDesign, frame: Any, at_mm: tuple[float, float]) -> float:
    """What silicone takes when one cavity and the frame above it are filled to the ledge."""
    cq = require()
    design, mold = built.design, built.solid("mold")
    low, high = np.array(built.box("skin"))
    # The block ends inside mold and frame: beside the frame is the play of its seat.
    x = high[0] + design.frame.wall_x_mm / 2
    y = high[1] + design.frame.wall_y_mm / 2
    bottom = design.mold.base_mm / 2
    top = design.mold.base_mm + (high[2] - low[2])
    corner = cq.Vector(at_mm[0] - x, at_mm[1] - y, bottom)
    block = cq.Solid.makeBox(2 * x, 2 * y, top - bottom, corner)
    # The frame's pilot holes stay empty: silicone takes what hangs together with the cavity.
    front = bounding_box(frame)[0][2]
    free = block.cut(mold, frame).Solids()
    return float(sum(s.Volume() for s in free if bounding_box(s)[0][2] < front - 1e-3))
