"""Numbered balloons beside a picture: where they stand, and leaders that cross nothing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
        """Corners of what it takes."""
        return np.stack([self.centre - RADIUS_MM - 0.3, self.centre + RADIUS_MM + 0.3])


def arranged(pieces: Sequence[tuple[Part, Sequence[Points]]], axis: Points) -> list[Balloon]:
    """Two rows of balloons beside the axis; each leader ends on its part and crosses no other.

    pieces: the visible lines of every piece, (n, 2) each in paper mm, y upwards. axis: direction
    of the rows. Of a part's visible points the one is taken from which the way to a row is free
    and shortest; a part that is hidden altogether has no balloon.
    """
    axis = axis / np.hypot(*axis)
    frame = np.stack([axis, [-axis[1], axis[0]]])  # along the axis, across it
    pieces = [(part, [line @ frame.T for line in lines]) for part, lines in pieces]
    segments = _segments(line for _, lines in pieces for line in lines)
    low, high = segments[..., 1].min() - ROW_MM, segments[..., 1].max() + ROW_MM
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
        others = _segments(line for p, lines in pieces if p is not part for line in lines)
        best = None
        for row in (high, low):
            order = np.argsort(np.abs(row - own[:, 1]), kind="stable")
            for point in own[order[: max(60, len(order) // 3)]]:
                crossed = _crossings(point, np.array([point[0], row]), segments)
                # A leader that ends where two parts seem to touch does not say which is meant.
                crossed += _nearest(point, others) < CLEAR_MM
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


def _segments(lines: Iterable[Points]) -> Points:
    """Polylines as segments (n, 2, 2)."""
    ends = [np.stack([line[:-1], line[1:]], axis=1) for line in lines]
    return np.concatenate([np.zeros((0, 2, 2)), *ends])


def _nearest(point: Points, segments: Points) -> float:
    """Distance from a point to the nearest of the segments (n, 2, 2)."""
    p, e = segments[:, 0], segments[:, 1] - segments[:, 0]
    along = ((point - p) * e).sum(axis=1) / np.maximum((e * e).sum(axis=1), 1e-12)
    gap = point - p - np.clip(along, 0, 1)[:, None] * e
    return float(np.hypot(gap[:, 0], gap[:, 1]).min(initial=np.inf))


def _crossings(a: Points, b: Points, segments: Points) -> int:
    """How many of the segments (n, 2, 2) the line from a to b crosses, its start left out."""
    start = a + 0.2 * (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
    d, p = b - start, segments[:, 0]
    e = segments[:, 1] - p
    cross = d[0] * e[:, 1] - d[1] * e[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = ((p[:, 0] - start[0]) * e[:, 1] - (p[:, 1] - start[1]) * e[:, 0]) / cross
        t = ((p[:, 0] - start[0]) * d[1] - (p[:, 1] - start[1]) * d[0]) / cross
        hit = (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    return int(np.count_nonzero(hit))
