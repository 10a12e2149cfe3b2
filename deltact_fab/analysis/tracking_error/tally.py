"""Sums over frames of one method and one indenter, and the figures that they make."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

MOVING_MM = 0.1
WRONG_MM = 0.1  # an error that no one who was told "confident" would expect
# Bins of the errors from LEAST_MM on, each a hundredth wider than the one before, to 300 mm.
LEAST_MM, WIDER, BINS = 1e-4, 1.01, 1500


@dataclass
class Mean:
    """A mean that can be joined with that of another part of the run."""

    total: float = 0.0
    n: int = 0

    def take(self, values: ArrayLike) -> None:
        """Count these values in."""
        self.total += float(np.sum(values))
        self.n += int(np.size(values))

    def __add__(self, other: Mean) -> Mean:
        return Mean(self.total + other.total, self.n + other.n)

    @property
    def value(self) -> float | None:
        """None where nothing was counted."""
        return ratio(self.total, self.n)


@dataclass
class ErrorTally:
    """Sums over frames; lengths in mm. The percentile is that of a histogram, to a hundredth.

    off, confident: errors of all moving visible pixels, and of the confident ones of them.
    in_plane: of the flow there, where it is read as in-plane motion. believed, lost: shares of the
    image, a value a frame.
    """

    at_dots: Mean = field(default_factory=Mean)
    at_moving_dots: Mean = field(default_factory=Mean)
    in_plane: Mean = field(default_factory=Mean)
    off: Mean = field(default_factory=Mean)
    confident: Mean = field(default_factory=Mean)
    believed: Mean = field(default_factory=Mean)
    lost: Mean = field(default_factory=Mean)
    histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(BINS, np.int64))
    n_moving: int = 0
    wrong_n: int = 0
    switches: int = 0
    bad_frames: int = 0
    peak_true_mm: float | None = None
    ms: list[float] = field(default_factory=list)

    @classmethod
    def of_frame(cls, confident_share: float, trusted: bool, cpu_ms: float) -> Self:
        """What a method says of one frame, without any error."""
        one = cls(bad_frames=int(not trusted), ms=[cpu_ms])
        one.believed.take(confident_share)
        return one

    def take_moving(self, errors_mm: NDArray[Any], confident: NDArray[np.bool_]) -> None:
        """Count in the moving visible pixels of a frame, (n,) errors and which are confident."""
        self.off.take(errors_mm)
        index = np.log(np.maximum(errors_mm, LEAST_MM) / LEAST_MM) / np.log(WIDER)
        index = np.minimum(index.astype(np.int64), BINS - 1)
        self.histogram += np.bincount(index, minlength=BINS)
        self.take_confident(errors_mm[confident], errors_mm.size)

    def take_confident(self, errors_mm: NDArray[Any], n_moving: int) -> None:
        """Add the confident ones (n,), out of this many moving visible pixels."""
        self.n_moving += n_moving
        self.confident.take(errors_mm)
        self.wrong_n += int((errors_mm > WRONG_MM).sum())

    def join(self, other: ErrorTally) -> None:
        """Count in another part of the run."""
        peaks = [v for v in (self.peak_true_mm, other.peak_true_mm) if v is not None]
        for one in fields(self):
            if one.name != "peak_true_mm":
                setattr(self, one.name, getattr(self, one.name) + getattr(other, one.name))
        self.peak_true_mm = max(peaks, default=None)

    def plain(self) -> dict[str, Any]:
        """All but milliseconds as plain data and an array, for `of`."""
        return {k: v for k, v in asdict(self).items() if k != "ms"}

    @classmethod
    def of(cls, plain: dict[str, Any]) -> Self:
        """What `plain` gave; milliseconds are not known."""
        means = {k: Mean(**v) for k, v in plain.items() if isinstance(v, dict)}
        return cls(**{**plain, **means})

    def figures(self) -> dict[str, Any]:
        """The figures of the report; None where nothing was measured."""
        n = self.believed.n
        return {
            "mean_at_dots_mm": self.at_dots.value,
            "mean_off_dots_mm": self.off.value,
            "p95_off_dots_mm": self._p95(),
            "mean_as_in_plane_mm": self.in_plane.value,
            "mean_confident_mm": self.confident.value,
            "coverage": ratio(self.confident.n, self.n_moving),
            "confident_wrong_share": ratio(self.wrong_n, self.confident.n),
            "confident_share": self.believed.value,
            "lost_share": self.lost.value,
            "n_moving_px": self.n_moving,
            "peak_true_mm": self.peak_true_mm,
            "ms_per_frame": float(np.median(self.ms)) if self.ms else None,
            "n_frames": n,
            "trusted_share": ratio(n - self.bad_frames, n),
            "reference_switches": self.switches,
        }

    def _p95(self) -> float | None:
        if not self.off.n:
            return None
        at = int(np.searchsorted(np.cumsum(self.histogram), 0.95 * self.off.n))
        return float(LEAST_MM * WIDER ** (at + 1))


def ratio(part: float, whole: int) -> float | None:
    """part / whole; None of nothing."""
    return part / whole if whole else None
