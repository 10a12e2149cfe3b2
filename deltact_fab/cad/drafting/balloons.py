"""Numbered balloons beside a picture: where they stand, and leaders that cross nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...aliases import Points
from ..part import Part

RADIUS_MM, BETWEEN_MM, ROW_MM = 3.2, 9.0, 11.0
CLEAR_MM = 1.0  # from a leader's end to the lines of another part
START_MM = 0.2  # a leader does not cross the line on which it starts


@dataclass(frozen=True)
class Balloon:
    """A numbered circle and its leader's end on the part; paper mm, y upwards."""

    part: Part
    centre: Points
    anchor: Points

    @property
    def reach(self) -> Points:
        """Corners of the room it needs."""
        return np.stack([self.centre - RADIUS_MM - 0.3, self.centre + RADIUS_MM + 0.3])


def arranged(pieces: Sequence[tuple[Part, Sequence[Points]]], axis: Points) -> list[Balloon]:
    """Two rows of balloons beside the axis; each leader ends on its part and crosses no other.

    pieces: the visible lines of every piece, (n, 2) each in paper mm, y upwards. axis: direction
    of the rows. Of a part's visible points the one is taken from which the way to a row is free
    and shortest; a part that is hidden altogether has no balloon.
    """
    import shapely

    axis = axis / np.hypot(*axis)
    frame = np.stack([axis, [-axis[1], axis[0]]])  # along the axis, across it
    lines = [(part.name, shapely.LineString(p @ frame.T)) for part, own in pieces for p in own]
    drawn = shapely.STRtree([line for _, line in lines])
    _, low, _, high = shapely.total_bounds(drawn.geometries)
    rows: dict[float, list[tuple[float, Points, Part]]] = {high + ROW_MM: [], low - ROW_MM: []}
    for part in {part.name: part for part, _ in pieces}.values():
        own = [line for name, line in lines if name == part.name]
        if not own:
            continue
        others = shapely.union_all([line for name, line in lines if name != part.name])
        points = np.tile(shapely.get_coordinates(own), (2, 1))
        row = np.repeat(list(rows), len(points) // 2)
        away = row - points[:, 1]
        ends = np.repeat(points[:, None], 2, axis=1)
        ends[:, 0, 1] += START_MM * np.sign(away)
        ends[:, 1, 1] = row
        # A leader that ends where two parts seem to touch does not say which is meant.
        crossed = 1 * shapely.dwithin(shapely.points(points), others, CLEAR_MM)
        met, _ = drawn.query(shapely.linestrings(ends), predicate="intersects")
        crossed += np.bincount(met, minlength=len(points))
        k = np.lexsort((np.abs(away).round(3), crossed))[0]
        rows[row[k]].append((float(points[k, 0]), points[k], part))
    balloons = []
    for across, entries in rows.items():
        entries.sort(key=lambda entry: entry[0])
        at = spread([entry[0] for entry in entries], BETWEEN_MM)
        for t, (_, anchor, part) in zip(at, entries, strict=True):
            balloons.append(Balloon(part, np.array([t, across]) @ frame, anchor @ frame))
    return balloons


def spread(wanted: Sequence[float], apart: float) -> list[float]:
    """Places in the order given, `apart` from one another, as near as may be to those wanted."""
    from scipy.optimize import isotonic_regression

    least = apart * np.arange(len(wanted))
    places: list[float] = (isotonic_regression(np.array(wanted) - least).x + least).tolist()
    return places
