"""Numbered balloons beside a picture: where they stand, and leaders that cross nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...aliases import Points
from ..part import Part

RADIUS_MM, BETWEEN_MM, ROW_MM = 3.2, 9.0, 11.0
CLEAR_MM = 1.0  # from a leader's end to the lines of another part


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
    pieces = [(part, [line @ frame.T for line in lines]) for part, lines in pieces]
    drawn = shapely.MultiLineString([line for _, lines in pieces for line in lines])
    low, high = drawn.bounds[1] - ROW_MM, drawn.bounds[3] + ROW_MM
    rows: dict[float, list[tuple[float, Points, Part]]] = {low: [], high: []}
    done: set[str] = set()
    for part, _ in pieces:
        if part.name in done:
            continue
        done.add(part.name)
        visible = [line for p, lines in pieces if p is part for line in lines]
        if not visible:
            continue
        own = np.concatenate(visible)
        others = shapely.MultiLineString([x for p, y in pieces if p is not part for x in y])
        best = None
        for row in (high, low):
            order = np.argsort(np.abs(row - own[:, 1]), kind="stable")
            for point in own[order[: max(60, len(order) // 3)]]:
                # Beside its own line, from which it starts.
                start = point[1] + 0.2 * np.sign(row - point[1])
                leader = shapely.LineString([(point[0], start), (point[0], row)])
                crossed = len(shapely.get_parts(leader.intersection(drawn)))
                # A leader that ends where two parts seem to touch does not say which is meant.
                crossed += others.distance(shapely.Point(point)) < CLEAR_MM
                cost = (crossed, round(abs(row - point[1]), 3))
                if best is None or cost < best[0]:
                    best = (cost, row, point)
        assert best is not None
        rows[best[1]].append((float(best[2][0]), best[2], part))
    balloons = []
    for row, entries in rows.items():
        entries.sort(key=lambda entry: entry[0])
        at = spread([entry[0] for entry in entries], BETWEEN_MM)
        for t, (_, anchor, part) in zip(at, entries, strict=True):
            balloons.append(Balloon(part, np.array([t, row]) @ frame, anchor @ frame))
    return balloons


def spread(wanted: Sequence[float], apart: float) -> list[float]:
    """Places in the order given, `apart` from one another, as near as may be to those wanted."""
    # Groups that touch share the error evenly.
    groups: list[list[float]] = []
    for value in wanted:
        groups.append([value])
        while (
            len(groups) > 1
            and _first(groups[-1], apart) < _first(groups[-2], apart) + len(groups[-2]) * apart
        ):
            groups[-2:] = [groups[-2] + groups[-1]]
    return [_first(group, apart) + i * apart for group in groups for i in range(len(group))]


def _first(group: Sequence[float], apart: float) -> float:
    return sum(v - i * apart for i, v in enumerate(group)) / len(group)
