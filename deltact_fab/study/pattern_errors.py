"""Tracking errors of the pattern selection: a pattern, an indenter and a tracker at a time.

The paper's error is that at the dots (Eq. 7), averaged over the frames of an indenter; a pattern's
is the mean of its indenters'. Its interval is taken over indenters, which differ most.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..analysis.tracking_error.tally import ErrorTally, Mean
from ..patterns.series.job import SeriesEntry
from . import intervals
from .intervals import Interval

Measure = Literal["at_dots", "off"]
_DEPTH = re.compile(r"/d(\d+\.\d+)/")


@dataclass(frozen=True)
class PrintedPattern:
    """A pattern as tables name it. d_mm, r: None where it is none of Algorithm 1.

    rounds: of the paper's two that it stands in. paper_mm: the paper's error, None where it gives
    none; paper_about: it applies to all patterns of this d.
    """

    name: str
    d_mm: float | None
    r: float | None
    rounds: tuple[int, ...] = ()
    paper_mm: float | None = None
    paper_about: bool = False

    @classmethod
    def of(cls, entry: SeriesEntry) -> PrintedPattern:
        """Of the paper's series."""
        recipe = entry.recipe
        return cls(
            entry.name, recipe.patch_mm, recipe.r, entry.rounds, entry.paper_error_mm,
            entry.paper_about,
        )  # fmt: skip

    @property
    def words(self) -> str:
        """As `d 0.075 r 0.6`."""
        return self.name if self.d_mm is None else f"d {self.d_mm:g} r {self.r:g}"


@dataclass(frozen=True)
class PressErrors:
    """One press under one pattern: sums by tracker, and a line a frame of FIGURES."""

    pattern: str
    press: str
    indenter: str
    tallies: dict[str, ErrorTally]
    rows: dict[str, NDArray[np.float64]]
    steps: tuple[str, ...]
    dots: dict[str, Any] | None
    left_out: tuple[str, ...]


def cells_of(value: Mapping[str, Any], press: str, indenter: str) -> list[PressErrors]:
    """What a job of `pattern_press.follow` found."""
    return [
        PressErrors(
            name,
            press,
            indenter,
            {m: ErrorTally.of(p, value[f"histogram|{name}|{m}"]) for m, p in by_method.items()},
            {m: value[f"rows|{name}|{m}"] for m in by_method},
            tuple(value["steps"]),
            value["dots"][name],
            tuple(value["left_out"][name]),
        )
        for name, by_method in value["tallies"].items()
    ]


class PatternErrors:
    """All cells of a study, joined as they are asked for."""

    def __init__(self, printed: Sequence[PrintedPattern], cells: Sequence[PressErrors]) -> None:
        self.printed = tuple(printed)
        self.cells = tuple(cells)
        self.methods = tuple(dict.fromkeys(m for cell in cells for m in cell.tallies))
        self.indenters = tuple(dict.fromkeys(cell.indenter for cell in cells))
        self._joined: dict[tuple[str, str, str], ErrorTally] = {}
        for cell in cells:
            for method, tally in cell.tallies.items():
                key = (cell.pattern, cell.indenter, method)
                self._joined.setdefault(key, ErrorTally()).join(tally)

    def tally(self, pattern: str, method: str, indenter: str | None = None) -> ErrorTally:
        """Of an indenter, or of all of them."""
        whole = ErrorTally()
        for (p, i, m), tally in self._joined.items():
            if (p, m) == (pattern, method) and indenter in (None, i):
                whole.join(tally)
        return whole

    def mean_mm(self, pattern: str, method: str, measure: Measure, indenter: str) -> float | None:
        """The error of one indenter, all its presses together; None where none was measured."""
        tally = self._joined.get((pattern, indenter, method))
        found: Mean | None = getattr(tally, measure) if tally else None
        return found.value if found else None

    def over_indenters(self, pattern: str, method: str, measure: Measure) -> Interval | None:
        """Mean over indenters and its interval; None where one of them has no error."""
        values = [self.mean_mm(pattern, method, measure, i) for i in self.indenters]
        known = [v for v in values if v is not None]
        if len(known) < len(self.indenters) or not known:
            return None
        return intervals.mean(known, self.indenters, "indenter", "positive")

    def difference(
        self, pattern: str, other: str, method: str, measure: Measure
    ) -> Interval | None:
        """The error of a pattern less that of another, indenter by indenter."""
        pairs = [
            (self.mean_mm(pattern, method, measure, i), self.mean_mm(other, method, measure, i))
            for i in self.indenters
        ]
        apart = [a - b for a, b in pairs if a is not None and b is not None]
        if len(apart) < len(pairs):
            return None
        return intervals.mean(apart, self.indenters, "indenter")

    def best(
        self, method: str, measure: Measure, among: Iterable[PrintedPattern] | None = None
    ) -> PrintedPattern | None:
        """The pattern with the least error; None where none has one."""
        found = [
            (known.value, n, p)
            for n, p in enumerate(self.printed if among is None else among)
            if (known := self.over_indenters(p.name, method, measure)) is not None
        ]
        return min(found)[2] if found else None

    def beside(self, best: PrintedPattern, method: str, measure: Measure) -> list[PrintedPattern]:
        """Patterns that the indenters do not tell from the best one, at 95 %."""
        found = []
        for other in self.printed:
            apart = self.difference(other.name, best.name, method, measure)
            if other != best and apart is not None and (apart.low is None or apart.low <= 0):
                found.append(other)
        return found

    def by_depth(self, pattern: str, method: str) -> dict[str, dict[str, float | None]]:
        """Means over frames at each depth: {"5": {"at_dots_mm", "off_dots_mm"}}."""
        sums: dict[str, list[NDArray[np.float64]]] = {}
        for cell in self.cells:
            if cell.pattern != pattern or method not in cell.rows:
                continue
            for step, line in zip(cell.steps, cell.rows[method], strict=False):
                if depth := _DEPTH.search(step):
                    sums.setdefault(f"{float(depth[1]):g}", []).append(line)
        found = {}
        for depth_mm, lines in sums.items():
            dots, off = np.array(lines).T[:2]
            found[depth_mm] = {"at_dots_mm": _mean(dots), "off_dots_mm": _mean(off)}
        return found


def _mean(values: NDArray[np.float64]) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else None
