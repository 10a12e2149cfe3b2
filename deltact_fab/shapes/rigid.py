"""A rigid indenter as numbers: its tips, its stem, and how deep it reaches.

The tip's lowest point is at z = 0 in the indenter's frame; the body lies above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..aliases import Field
from .posed import PlainTip, PosedTip

Tip = PlainTip | PosedTip

REACH_MM = 12.0  # as long as the standard gel is thick


@dataclass(frozen=True)
class Indenter:
    """A rigid indenter: tips with their shanks on one back plate, and a stem.

    name: what the user typed, normalised (`sphere:10`, `4dots`).
    tips: what touches the gel; outside all of them the indenter is out of reach.
    stem_diameter_mm: the stem that fits the stage's tool holder.
    stem_flat_at_mm: the stem's flat from its axis, on the side of the tips' +x and over the whole
        length: it clocks the tips in the tool holder. The same for all.
    reach_mm: free length from the lowest point up to the back plate, that is, the depth to which
        tips and shanks alone can be pressed.
    """

    name: str
    tips: tuple[Tip, ...]
    stem_diameter_mm: float = 6.0
    stem_length_mm: float = 20.0
    stem_flat_at_mm: float = 2.2
    reach_mm: float = REACH_MM

    @property
    def slug(self) -> str:
        """The name as it may stand in a file name."""
        return self.name.replace(":", "-").replace(".", "p")

    @property
    def footprint_half_mm(self) -> tuple[float, float]:
        """Half sides of the box around the tips as seen along z (x, y)."""
        return (
            max(abs(t.x_mm) + t.half_mm[0] for t in self.tips),
            max(abs(t.y_mm) + t.half_mm[1] for t in self.tips),
        )

    @property
    def equator_mm(self) -> float:
        """Depth at which the first tip is in up to where its sides turn vertical.

        A model of the gel's face as a height field ends there; the indenter itself goes on.
        """
        return min(t.equator_mm for t in self.tips)

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        """Height of the indenter's underside above its lowest point, inf where there is none.

        x_mm, y_mm: arrays of one shape, relative to the indenter's axis. Returns that shape. Shanks
        and back plate are not in it: they are out of sight from below or further away.
        """
        height = np.full(np.broadcast(x_mm, y_mm).shape, np.inf)
        for tip in self.tips:
            height = np.minimum(height, tip.height_mm(x_mm, y_mm))
        return height
