"""What a circle holds of the lines and faces of a view, to be drawn larger."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...aliases import Points

SIDES = 120


@dataclass(frozen=True)
class Circle2:
    """A circle on the model's plane; what it cuts off ends on a polygon of SIDES sides in it."""

    centre: tuple[float, float]
    radius: float

    @cached_property
    def _clip(self) -> Any:
        from ezdxf.math import Vec2
        from ezdxf.math.clipping import ConvexClippingPolygon2d

        turn = 2 * np.pi * np.arange(SIDES) / SIDES
        ring = np.stack([np.cos(turn), np.sin(turn)], axis=1) * self.radius + self.centre
        return ConvexClippingPolygon2d(Vec2.list(ring.tolist()))

    def of_lines(self, lines: Iterable[Points]) -> tuple[Points, ...]:
        """Polylines (n, 2), cut where they leave the circle."""
        from ezdxf.math import Vec2

        pieces = (p for line in lines for p in self._clip.clip_polyline(Vec2.list(line.tolist())))
        return tuple(_points(piece) for piece in pieces if len(piece) > 1)

    def of_face(self, loops: Sequence[Points]) -> list[Points]:
        """Loops around and within a face, cut likewise and closed along the circle."""
        from ezdxf.math import Vec2

        pieces = (p for loop in loops for p in self._clip.clip_polygon(Vec2.list(loop.tolist())))
        return [_points(piece) for piece in pieces if len(piece) > 2]


def _points(piece: Sequence[Any]) -> Points:
    return np.array([(p.x, p.y) for p in piece])
