"""Sums over frames of one method and one indenter, and the figures that they make."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

MOVING_MM = 0.1
WRONG_MM = 0.1  # an error that no one who was told "confident" would expect
BIN_MM = 1e-4
END_MM = 5.0
BINS = round(END_MM / BIN_MM)  # and one more, for what lies beyond


@dataclass
class Mean:
    """A mean that can be joined with that of another part of the run."""

    total: float = 0.0
    n: int = 0

    def take(self, values: ArrayLike) -> None:
        """Count these values in."""
        self.total += float(np.sum(values))
        self.n += int(np.size(values))

    def join(self, other: Mean) -> None:
        """Count in what another one has counted."""
        self.total += other.total
        self.n += other.n

    @property
    def value(self) -> float | None:
        """None where nothing was counted."""
        return self.total / self.n if self.n else None


_MEANS = (
    "at_dots", "at_moving_dots", "still", "in_plane", "off", "confident", "believed", "matched",
    "predicted", "lost",
)  # fmt: skip
_COUNTS = ("n_moving", "wrong_n", "switches", "bad_frames")
_LARGEST = ("worst_confident_mm", "peak_true_mm", "peak_in_plane_mm")


@dataclass
class ErrorTally:
    """Sums over frames; lengths in mm. Percentiles come from a histogram of 0.1 um bins.

    off, confident: errors of all moving visible pixels, and of the confident ones of them.
    believed, matched, predicted, lost: shares of the image, a value a frame.
    """

    at_dots: Mean = field(default_factory=Mean)
    at_moving_dots: Mean = field(default_factory=Mean)
    still: Mean = field(default_factory=Mean)
    in_plane: Mean = field(default_factory=Mean)
    off: Mean = field(default_factory=Mean)
    confident: Mean = field(default_factory=Mean)
    believed: Mean = field(default_factory=Mean)
    matched: Mean = field(default_factory=Mean)
    predicted: Mean = field(default_factory=Mean)
    lost: Mean = field(default_factory=Mean)
    histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(BINS + 1, np.int64))
    n_moving: int = 0
    wrong_n: int = 0
    worst_confident_mm: float = 0.0
    peak_true_mm: float | None = None
    peak_in_plane_mm: float | None = None
    ms: list[float] = field(default_factory=list)
    switches: int = 0
    bad_frames: int = 0

    def take_moving(self, errors_mm: NDArray[Any], confident: NDArray[np.bool_]) -> None:
        """Count in the moving visible pixels of a frame, (n,) errors and which are confident."""
        self.off.take(errors_mm)
        index = np.minimum((errors_mm / BIN_MM).astype(np.int64), BINS)
        self.histogram += np.bincount(index, minlength=BINS + 1)
        self.take_confident(errors_mm[confident], errors_mm.size)

    def take_confident(self, errors_mm: NDArray[Any], n_moving: int) -> None:
        """Add the confident ones (n,), out of this many moving visible pixels."""
        self.n_moving += n_moving
        self.confident.take(errors_mm)
        self.wrong_n += int((errors_mm > WRONG_MM).sum())
        self.worst_confident_mm = max(self.worst_confident_mm, float(errors_mm.max(initial=0.0)))

    def join(self, other: ErrorTally) -> None:
        """Count in another part of the run."""
        for name in _MEANS:
            getattr(self, name).join(getattr(other, name))
        for name in _COUNTS:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for name in _LARGEST:
            setattr(self, name, largest(getattr(self, name), getattr(other, name)))
        self.histogram = self.histogram + other.histogram
        self.ms += other.ms

    def plain(self) -> dict[str, Any]:
        """All but histogram and milliseconds as plain data, for `of`."""
        means = {name: [getattr(self, name).total, getattr(self, name).n] for name in _MEANS}
        return means | {name: getattr(self, name) for name in (*_COUNTS, *_LARGEST)}

    @classmethod
    def of(cls, plain: dict[str, Any], histogram: NDArray[np.int64]) -> Self:
        """What `plain` gave, and its histogram; milliseconds are not known."""
        known: dict[str, Any] = {name: Mean(*plain[name]) for name in _MEANS}
        known |= {name: plain[name] for name in (*_COUNTS, *_LARGEST)}
        return cls(**known, histogram=histogram)

    @property
    def n_frames(self) -> int:
        """Frames that were counted in."""
        return self.believed.n

    def figures(self) -> dict[str, Any]:
        """The figures of the report; None where nothing was measured.

        A percentile beyond the histogram's end is None in `p95_off_dots_mm`, and the end stands in
        `p95_off_dots_beyond_mm`, which is None otherwise.
        """
        p95, beyond = self._p95()
        n, ms = self.n_frames, self.ms
        p50_ms, p95_ms = (float(v) for v in np.percentile(ms, (50, 95))) if ms else (None,) * 2
        return {
            "mean_at_dots_mm": self.at_dots.value,
            "mean_at_moving_dots_mm": self.at_moving_dots.value,
            "mean_off_dots_mm": self.off.value,
            "p95_off_dots_mm": p95,
            "p95_off_dots_beyond_mm": beyond,
            "mean_confident_mm": self.confident.value,
            "max_confident_mm": self.worst_confident_mm if self.confident.n else None,
            "coverage": ratio(self.confident.n, self.n_moving),
            "confident_wrong_share": ratio(self.wrong_n, self.confident.n),
            "confident_share": self.believed.value,
            "matched_share": self.matched.value,
            "predicted_share": self.predicted.value,
            "lost_share": self.lost.value,
            "mean_still_mm": self.still.value,
            "mean_as_in_plane_mm": self.in_plane.value,
            "n_moving_px": self.n_moving,
            "n_dots": self.at_dots.n,
            "peak_true_mm": self.peak_true_mm,
            "peak_in_plane_mm": self.peak_in_plane_mm,
            "cpu_ms": {"p50": p50_ms, "p95": p95_ms},
            "ms_per_frame": p50_ms,
            "n_frames": n,
            "trusted_share": ratio(n - self.bad_frames, n),
            "reference_switches": self.switches,
            "frames_with_bad_match": self.bad_frames,
        }

    def _p95(self) -> tuple[float | None, float | None]:
        if not self.off.n:
            return None, None
        at = int(np.searchsorted(np.cumsum(self.histogram), 0.95 * self.off.n))
        return (None, END_MM) if at >= BINS else ((at + 1) * BIN_MM, None)


def confident_figures(errors_mm: NDArray[Any], n_moving: int) -> dict[str, float | None]:
    """Add a frame: (n,) errors of the confident pixels, out of this many moving visible ones."""
    n = errors_mm.size
    return {
        "mean_confident_mm": ratio(float(errors_mm.sum()), n),
        "coverage": ratio(n, n_moving),
        "confident_wrong_share": ratio(int((errors_mm > WRONG_MM).sum()), n),
    }


def shown(row: dict[str, Any], key: str) -> Any:
    """A figure for people: `> 5` where a percentile lies beyond the end of its histogram."""
    beyond = row.get(key.removesuffix("_mm") + "_beyond_mm")
    return row[key] if beyond is None else f"> {beyond:g}"


def ratio(part: float, whole: int) -> float | None:
    """part / whole; None of nothing."""
    return part / whole if whole else None


def largest(a: float | None, b: float | None) -> float | None:
    """The larger one of those that are known."""
    known = [v for v in (a, b) if v is not None]
    return max(known, default=None)
