"""What the flow is compared with, truth and dots, and sums of its errors over many frames."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deltact_fab.common import Field
from deltact_fab.sensor import CameraModel, Rectified, folded_pixels

from ...measure.compose import inside
from ...measure.dots.detect import Polarity
from ...measure.dots.tracker import DotObservation, DotTracker

MOVING_MM = 0.1
WRONG_FLOW_MM = 0.1  # an error that no one who was told "confident" would expect
# Bins of the errors from LEAST_MM on, each a hundredth wider than the one before, to 300 mm.
LEAST_MM, WIDER, BINS = 1e-4, 1.01, 1500


@dataclass
class Mean:
    """A mean that can be joined with that of another part of the run."""

    total: float = 0.0
    n: int = 0

    def take(self, values: ArrayLike) -> None:
        self.total += float(np.asarray(values).sum())
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

    off_dots, error_confident: of all moving visible pixels, and of the confident ones.
    in_plane: of the flow there, where it is read as in-plane motion. confident_share, lost_share:
    of the image, a value a frame.
    """

    at_dots: Mean = field(default_factory=Mean)
    at_moving_dots: Mean = field(default_factory=Mean)
    in_plane: Mean = field(default_factory=Mean)
    off_dots: Mean = field(default_factory=Mean)
    error_confident: Mean = field(default_factory=Mean)
    confident_share: Mean = field(default_factory=Mean)
    lost_share: Mean = field(default_factory=Mean)
    histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(BINS, np.int64))
    n_moving: int = 0
    wrong_n: int = 0
    switches: int = 0
    untrusted_frames: int = 0
    peak_true_mm: float | None = None
    ms: list[float] = field(default_factory=list)

    @classmethod
    def of_frame(cls, confident_share: float, trusted: bool, cpu_ms: float) -> Self:
        """What a method says of one frame, without any error."""
        one = cls(untrusted_frames=int(not trusted), ms=[cpu_ms])
        one.confident_share.take(confident_share)
        return one

    def take_moving(self, errors_mm: NDArray[Any], confident: NDArray[np.bool_]) -> None:
        """Count in the moving visible pixels of a frame, (n,) errors and which are confident."""
        self.off_dots.take(errors_mm)
        index = np.log(np.maximum(errors_mm, LEAST_MM) / LEAST_MM) / np.log(WIDER)
        index = np.minimum(index.astype(np.int64), BINS - 1)
        self.histogram += np.bincount(index, minlength=BINS)
        self.take_confident(errors_mm[confident], errors_mm.size)

    def take_confident(self, errors_mm: NDArray[Any], n_moving: int) -> None:
        """Add the confident ones (n,), out of this many moving visible pixels."""
        self.n_moving += n_moving
        self.error_confident.take(errors_mm)
        self.wrong_n += int((errors_mm > WRONG_FLOW_MM).sum())

    def join(self, other: ErrorTally) -> None:
        peaks = [v for v in (self.peak_true_mm, other.peak_true_mm) if v is not None]
        for one in fields(self):
            if one.name != "peak_true_mm":
                setattr(self, one.name, getattr(self, one.name) + getattr(other, one.name))
        self.peak_true_mm = max(peaks, default=None)

    def figures(self) -> dict[str, Any]:
        """The figures of the report; None where nothing was measured."""
        n = self.confident_share.n
        return {
            "mean_at_dots_mm": self.at_dots.value,
            "mean_off_dots_mm": self.off_dots.value,
            "p95_off_dots_mm": self._p95(),
            "mean_as_in_plane_mm": self.in_plane.value,
            "mean_confident_mm": self.error_confident.value,
            "coverage": ratio(self.error_confident.n, self.n_moving),
            "confident_wrong_share": ratio(self.wrong_n, self.error_confident.n),
            "confident_share": self.confident_share.value,
            "lost_share": self.lost_share.value,
            "n_moving_px": self.n_moving,
            "peak_true_mm": self.peak_true_mm,
            "ms_per_frame": float(np.median(self.ms)) if self.ms else None,
            "n_frames": n,
            "trusted_share": ratio(n - self.untrusted_frames, n),
            "reference_switches": self.switches,
        }

    def _p95(self) -> float | None:
        if not self.off_dots.n:
            return None
        at = int(np.searchsorted(np.cumsum(self.histogram), 0.95 * self.off_dots.n))
        return float(LEAST_MM * WIDER ** (at + 1))


def ratio(part: float, whole: int) -> float | None:
    """part / whole; None of nothing."""
    return part / whole if whole else None


DOTS = "dots"
"""The method's name where there is nothing but dots to follow; its pixels are dots."""
MIN_FOUND_SHARE = 0.8  # of the dots, for a frame to be trusted


@dataclass
class DotTally:
    """Errors of the dots themselves against truth, and how many were lost.

    A misidentified one is off by half the distance of two dots or more.
    """

    errors: Mean = field(default_factory=Mean)
    worst_mm: float = 0.0
    seen: int = 0
    lost: int = 0

    def join(self, other: DotTally) -> None:
        self.errors += other.errors
        self.worst_mm = max(self.worst_mm, other.worst_mm)
        self.seen += other.seen
        self.lost += other.lost

    def figures(self) -> dict[str, Any]:
        """Errors against truth (None on a real rig), and how many were seen."""
        return {
            "mean_vs_truth_mm": self.errors.value,
            "max_vs_truth_mm": self.worst_mm if self.errors.n else None,
            "seen": self.seen,
            "lost": self.lost,
        }


@dataclass(frozen=True)
class PatternDots:
    """The dots of a printed pattern, and the camera whose images are tracked.

    dots_mm: centres at rest, (n, 2); n = 0 without dots.
    """

    camera: CameraModel
    dots_mm: Field
    diameter_mm: float
    polarity: Polarity

    @classmethod
    def of(cls, camera: CameraModel, pattern: dict[str, Any]) -> PatternDots:
        """pattern: as a run's `pattern.json` has it."""
        dots_mm = np.asarray(pattern.get("dots_mm", []), dtype=float).reshape(-1, 2)
        # Dark on light, where the recipe's dots are nearer to black; else white on colours.
        colour = str((pattern["recipe"].get("dots") or {}).get("colour", "#ffffff"))
        levels = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
        polarity: Polarity = "dark" if sum(levels) < 3 * 128 else "white"
        return cls(camera, dots_mm, float(pattern["dot_diameter_mm"]), polarity)


class DotFollower:
    """Follows the dots of one press, and counts them."""

    def __init__(self, marks: PatternDots) -> None:
        camera = marks.camera
        self.rest_px = camera.rest_px(marks.dots_mm)
        self.mm_per_px = camera.mm_per_px
        self.shape = camera.height_px, camera.width_px
        self.tracker = DotTracker(
            self.rest_px, marks.diameter_mm / self.mm_per_px, polarity=marks.polarity
        )
        self.tally = DotTally()

    def follow(self, image: NDArray[np.uint8]) -> DotObservation:
        """The dots of the next frame. Raises SensorError when the first one does not show them."""
        seen = self.tracker.update(image)
        found = int(np.isfinite(seen.displacement_px[:, 0]).sum())
        self.tally.seen += found
        self.tally.lost += len(self.rest_px) - found
        return seen

    def take(self, seen: DotObservation, true_px: Field) -> None:
        """Count a frame's errors in. true_px: (n, 2) motion of the dots."""
        errors = _lengths(seen.displacement_px - true_px) * self.mm_per_px
        self.tally.errors.take(errors)
        self.tally.worst_mm = max(self.tally.worst_mm, float(errors.max(initial=0.0)))

    def as_method(self, seen: DotObservation, true_px: Field | None) -> ErrorTally:
        """A frame as that of a method whose pixels are the dots.

        true_px: (n, 2) motion of the dots, None where no truth is known. A dot that is found is a
        confident pixel; one that is lost has no error, so that there is none over all of them.
        """
        share = float(np.isfinite(seen.displacement_px[:, 0]).mean())
        one = ErrorTally.of_frame(share, share >= MIN_FOUND_SHARE, seen.cpu_ms)
        if true_px is not None:
            visible = inside(self.rest_px + true_px, *self.shape)
            moved_mm = np.hypot(*true_px.T) * self.mm_per_px
            moving = visible & (moved_mm >= MOVING_MM)
            errors = _lengths((seen.displacement_px - true_px)[moving]) * self.mm_per_px
            one.take_confident(errors, int(moving.sum()))
            one.peak_true_mm = float(moved_mm[visible].max()) if visible.any() else None
        return one

    def errors_of(
        self, flow_px: NDArray[np.float32], seen: DotObservation
    ) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """The paper's error (k,) mm of flow (h, w, 2) at the k dots found; which of them move."""
        off_px = sampled(flow_px, self.tracker.first_px) - seen.displacement_px
        moving = np.hypot(*seen.displacement_px.T) * self.mm_per_px >= MOVING_MM
        return _lengths(off_px) * self.mm_per_px, moving[np.isfinite(off_px[:, 0])]


def _lengths(vectors: Field) -> NDArray[Any]:
    """Of those that are known, of vectors (n, 2)."""
    lengths = np.hypot(*vectors.T)
    return lengths[np.isfinite(lengths)]


DOT_MARGIN_PX = 3.0


@dataclass(frozen=True)
class TrueFrame:
    """True motion of every rest pixel, projected and in-plane, and which of them move.

    moving: (h, w) bool, of the visible ones. peak_mm: of the visible pixels, None where none is.
    """

    flow_px: NDArray[np.float64]
    in_plane_mm: NDArray[np.float64]
    moving: NDArray[np.bool_]
    peak_mm: float | None

    @classmethod
    def of(
        cls,
        flow: NDArray[np.float64],
        in_plane: NDArray[np.float64],
        seen: NDArray[np.bool_],
        mm_per_px: float,
    ) -> TrueFrame:
        """flow, in_plane: (h, w, 2), px and mm, of what every pixel sees at rest.

        seen: (h, w) rest pixels that the camera sees.
        """
        h, w = seen.shape
        y, x = np.mgrid[:h, :w]
        to = np.stack((x + flow[..., 0], y + flow[..., 1]), axis=-1)
        visible = inside(to, h, w)
        # Where a steep flank hides what is behind it, no one point of the face is the true one.
        disputed = folded_pixels(to, seen.shape)
        column, row = np.rint(to[visible]).astype(int).T
        visible[visible] = seen[visible] & seen[row, column] & ~disputed[row, column]
        length_mm = np.hypot(flow[..., 0], flow[..., 1]) * mm_per_px
        peak = float(length_mm[visible].max()) if visible.any() else None
        return cls(flow, in_plane, visible & (length_mm >= MOVING_MM), peak)

    @staticmethod
    def imaged_pixels(camera: CameraModel) -> NDArray[np.bool_]:
        """Pixels (h, w) that hold an image: a rectified view may go beyond what the lens saw."""
        if isinstance(camera, Rectified):
            return camera.visible_pixels()
        return np.ones((camera.height_px, camera.width_px), bool)


def off_dots(
    camera: CameraModel, dots_mm: NDArray[np.float64], diameter_mm: float
) -> NDArray[np.bool_]:
    """(h, w) rest pixels that lie on no dot, with a margin for its blurred edge."""
    import cv2

    radius_px = diameter_mm / 2 / camera.mm_per_px + DOT_MARGIN_PX
    mask = np.ones((camera.height_px, camera.width_px), np.uint8)
    for x, y in camera.rest_px(dots_mm):
        cv2.circle(mask, (round(x), round(y)), int(np.ceil(radius_px)), 0, -1)
    return mask.astype(bool)


def sampled(flow: NDArray[Any], px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Flow (h, w, 2) at points (n, 2) px, bilinear; NaN where a point is NaN."""
    from scipy.ndimage import map_coordinates

    known = np.isfinite(px).all(axis=1)
    found = np.full(px.shape, np.nan)
    for k in (0, 1):
        found[known, k] = map_coordinates(
            flow[..., k], px[known, ::-1].T, np.float64, order=1, mode="nearest"
        )
    return found
