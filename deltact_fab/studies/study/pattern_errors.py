"""Tracking errors of the pattern selection, by pattern, indenter and tracker.

The paper's error is that at the dots (Eq. 7), for dots, frames and indenters that it does not
specify: each measure is one interpretation of its text. A pattern's error is the mean over
indenters, with an interval over indenters, which differ most.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from deltact_fab.estimate import ErrorTally, FlowTracker, Interval
from deltact_fab.fabricate import SeriesEntry

Measure = Literal["at_dots", "at_moving_dots", "off_dots"]
SUMMED_FLOW, COMPOSED_FLOW, OUR_FLOW = "farneback/summed", "farneback/composed", "fused"
FLOW_NAMES = {
    SUMMED_FLOW: "the paper's text, summed",
    COMPOSED_FLOW: "the paper's text, composed",
    FlowTracker.PAPER: "the tracker of its group",
    OUR_FLOW: "our tracker",
}
"""The text's "superposition" of flows may be a sum at fixed pixels or a composition."""
MIN_DRAG_FRAMES = 3
"""By hand: frames at one depth that make it a depth of drags; fewer take in the way down."""
DRAG_EDGES_MM = (0.0, 1.0, 2.0, 4.0, 7.0)
"""By hand: bin edges of the drag length; finer bins have few frames."""


@dataclass(frozen=True)
class PressErrors:
    """Errors of one press with one pattern: sums by tracker; a row of FRAME_KEYS per frame.

    path: (n, 2), depth and drag length per frame, mm.
    """

    pattern: str
    press: str
    indenter: str
    tallies: dict[str, ErrorTally]
    rows: dict[str, NDArray[np.float64]]
    path: NDArray[np.float64]
    dots: dict[str, Any] | None
    left_out: tuple[str, ...]


class PatternErrors:
    """Errors of all presses of a study; those of one pattern and indenter are pooled."""

    def __init__(self, printed: Sequence[SeriesEntry], cells: Sequence[PressErrors]) -> None:
        self.printed = tuple(printed)
        self.cells = tuple(cells)
        self.methods = tuple(dict.fromkeys(m for cell in cells for m in cell.tallies))
        self.indenters = tuple(dict.fromkeys(cell.indenter for cell in cells))
        self._joined: dict[tuple[str, str, str], ErrorTally] = {}
        for cell in cells:
            for method, tally in cell.tallies.items():
                key = (cell.pattern, cell.indenter, method)
                self._joined.setdefault(key, ErrorTally()).join(tally)

    def figures(self, pattern: str, method: str) -> dict[str, Any]:
        """Pooled figures of all indenters, see `ErrorTally.figures`."""
        total = ErrorTally()
        for (p, _, m), tally in self._joined.items():
            if (p, m) == (pattern, method):
                total.join(tally)
        return total.figures()

    def by_indenter(
        self, pattern: str, method: str, measure: Measure
    ) -> NDArray[np.float64] | None:
        """Mean error per indenter, mm, its presses pooled; None if one has no error."""
        tallies = [self._joined.get((pattern, i, method)) for i in self.indenters]
        values = [None if tally is None else getattr(tally, measure).value for tally in tallies]
        measured = [v for v in values if v is not None]
        return np.array(measured) if measured and len(measured) == len(values) else None

    def mean(self, pattern: str, method: str, measure: Measure) -> Interval | None:
        """Mean over indenters with interval; None if one has no error."""
        errors = self.by_indenter(pattern, method, measure)
        if errors is None:
            return None
        return Interval.mean(errors, self.indenters, "indenter", "positive")

    def best(
        self, method: str, measure: Measure, among: Iterable[SeriesEntry]
    ) -> SeriesEntry | None:
        """Pattern with the smallest error; None if there is none."""
        candidates = [
            (interval.value, n, p)
            for n, p in enumerate(among)
            if (interval := self.mean(p.name, method, measure)) is not None
        ]
        return min(candidates)[2] if candidates else None

    def error_ratio(
        self, above: Sequence[str], below: Sequence[str], method: str, level: float = 0.95
    ) -> Interval | None:
        """Ratio of the errors at the dots of two groups of patterns; None if unknown."""
        sides = []
        for names in (above, below):
            per_pattern = [self.by_indenter(name, method, "at_dots") for name in names]
            measured = [e for e in per_pattern if e is not None]
            if not measured or len(measured) < len(per_pattern):
                return None
            sides.append(np.mean(measured, axis=0))
        top, bottom = sides
        return Interval.ratio(top, bottom, self.indenters, "indenter", level)

    def along_path(self, pattern: str, method: str) -> list[dict[str, Any]]:
        """Means over frames by depth and drag length, mm, in order."""
        parts: dict[tuple[float, int], list[NDArray[np.float64]]] = {}
        for cell in self.cells:
            if cell.pattern != pattern or method not in cell.rows:
                continue
            depths, counts = np.unique(cell.path[:, 0].round(2), return_counts=True)
            dragged = depths[(counts >= MIN_DRAG_FRAMES) & (depths > 0)]  # not on the way down
            for (depth_mm, drag_mm), line in zip(cell.path, cell.rows[method], strict=False):
                drag = int(np.searchsorted(DRAG_EDGES_MM, drag_mm - 1e-6))
                if round(float(depth_mm), 2) in dragged:
                    parts.setdefault((round(float(depth_mm), 2), drag), []).append(line)
        return [
            {
                "depth_mm": depth_mm,
                "drag_from_mm": DRAG_EDGES_MM[max(drag - 1, 0)],
                "drag_to_mm": DRAG_EDGES_MM[drag] if drag < len(DRAG_EDGES_MM) else None,
                "frames": len(parts[depth_mm, drag]),
                **dict(zip(("at_dots_mm", "off_dots_mm", "lost_pixels"),
                           map(_finite_mean, np.array(parts[depth_mm, drag]).T), strict=True)),
            }
            for depth_mm, drag in sorted(parts)
        ]  # fmt: skip


def _finite_mean(values: NDArray[np.float64]) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else None
