"""How a printed part lies on the printer's platform. Imports no CAD kernel.

Platform frame: z away from the platform, so that every part is at z >= 0; x, y along its sides.
What is exported to print, what the checks measure and what the guide says follow from one value.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Side = Literal["-x", "+x", "-y", "+y", "-z", "+z"]
Matrix = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]

# Quarter turns, exact, by the side of the part's own frame that comes to face the platform.
_DOWN: dict[str, Matrix] = {
    "-z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "+z": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "-y": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "+y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "-x": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "+x": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
}

SELF_SUPPORTING_DEG = 19.0
"""Least slope to the platform that SLA prints without support: the 19 degrees of service bureaus'
design guides for stereolithography (after Formlabs). Assumed: a printer's own may differ."""


@dataclass(frozen=True)
class PrintPose:
    """down: the side of the part's frame that faces the platform; face: what that side is called.

    tilt_deg: then turned by so much about the platform's x, which lifts the side at +y; such a
    part stands on supports and touches the platform nowhere. supports: where they may be, and
    none where it is empty.
    """

    down: Side = "-z"
    face: str = "underside"
    tilt_deg: float = 0.0
    supports: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.tilt_deg <= 80 or (self.tilt_deg and not self.supports):
            raise ValueError(
                f"tilt_deg from 0 to 80, and a tilted part says where its supports are: "
                f"{self.tilt_deg:g} with supports {self.supports!r}"
            )

    @property
    def turn(self) -> Matrix:
        """Rotation from the part's frame to the platform's; a part that lies flat, exactly."""
        down = _DOWN[self.down]
        if not self.tilt_deg:
            return down
        c, s = math.cos(math.radians(self.tilt_deg)), math.sin(math.radians(self.tilt_deg))
        x, y, z = down
        lower = tuple(c * b - s * a for a, b in zip(z, y, strict=True))
        upper = tuple(s * b + c * a for a, b in zip(z, y, strict=True))
        return x, (lower[0], lower[1], lower[2]), (upper[0], upper[1], upper[2])

    @property
    def words(self) -> str:
        """The same for whoever prints it."""
        if self.tilt_deg:
            return f"{self.face} down, tilted by {self.tilt_deg:g}°, supports {self.supports}"
        how = f"supports {self.supports}" if self.supports else "no supports"
        return f"{self.face} down, straight on the platform, {how}"

    def size_mm(self, low: tuple[float, ...], high: tuple[float, ...]) -> tuple[float, ...]:
        """Sides (x, y, z) as it lies, from its box; of a tilted part an upper bound."""
        sides = [b - a for a, b in zip(low, high, strict=True)]
        return tuple(sum(abs(t) * s for t, s in zip(row, sides, strict=True)) for row in self.turn)


FLAT = PrintPose()
