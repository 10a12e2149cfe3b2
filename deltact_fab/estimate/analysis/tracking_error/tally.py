"""References of the flow, truth and dots, and sums of its errors over many frames."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deltact_fab.common import Field
from deltact_fab.sensor import CameraModel, Rectified, folded_pixels

from ...measure.compose import is_inside
from ...measure.dots.detect import Polarity
from ...measure.dots.tracker import DotObservation, DotTracker

MOVING_MM = 0.1  # decision 0004
WRONG_FLOW_MM = 0.1  # error of a confident pixel that counts as wrong, decision 0004
# By hand: bins of errors from MIN_BIN_MM to 300 mm, 1 % wide, the accuracy of the percentile.
MIN_BIN_MM, BIN_RATIO, ERROR_BINS = 1e-4, 1.01, 1500


@dataclass
class Mean:
    """A mean that can be joined with that of another part of the run."""

    total: float = 0.0
    n: int = 0

    def add(self, values: ArrayLike) -> None:
        self.total += float(np.asarray(values).sum())
        self.n += int(np.size(values))

    def __add__(self, mean: Mean) -> Mean:
        return Mean(self.total + mean.total, self.n + mean.n)

    @property
    def value(self) -> float | None:
        """None where nothing was counted."""
        return ratio(self.total, self.n)


@dataclass
class ErrorTally:
    """Sums over frames; lengths in mm. The percentile is from a histogram, accurate to 1 %.

    off_dots, error_confident: of all moving visible pixels, and of the confident ones.
    in_plane: error there if the flow is read as in-plane displacement. confident_share,
    lost_share: of the image, one value per frame.
    """

    at_dots: Mean = field(default_factory=Mean)
    at_moving_dots: Mean = field(default_factory=Mean)
    in_plane: Mean = field(default_factory=Mean)
    off_dots: Mean = field(default_factory=Mean)
    error_confident: Mean = field(default_factory=Mean)
    confident_share: Mean = field(default_factory=Mean)
    lost_share: Mean = field(default_factory=Mean)
    histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(ERROR_BINS, np.int64))
    n_moving: int = 0
    wrong_n: int = 0
    switches: int = 0
    untrusted_frames: int = 0
    peak_true_mm: float | None = None
    ms: list[float] = field(default_factory=list)

    @classmethod
    def for_frame(cls, confident_share: float, trusted: bool, cpu_ms: float) -> Self:
        """Start the tally of one frame of a method, without any error."""
        tally = cls(untrusted_frames=int(not trusted), ms=[cpu_ms])
        tally.confident_share.add(confident_share)
        return tally

    def add_moving(self, errors_mm: NDArray[Any], confident: NDArray[np.bool_]) -> None:
        """Add the moving visible pixels of a frame: errors (n,), and mask of confident ones."""
        self.off_dots.add(errors_mm)
        index = np.log(np.maximum(errors_mm, MIN_BIN_MM) / MIN_BIN_MM) / np.log(BIN_RATIO)
        index = np.minimum(index.astype(np.int64), ERROR_BINS - 1)
        self.histogram += np.bincount(index, minlength=ERROR_BINS)
        self.add_confident(errors_mm[confident], errors_mm.size)

    def add_confident(self, errors_mm: NDArray[Any], n_moving: int) -> None:
        """Add the errors (n,) of the confident ones out of n_moving moving visible pixels."""
        self.n_moving += n_moving
        self.error_confident.add(errors_mm)
        self.wrong_n += int((errors_mm > WRONG_FLOW_MM).sum())

    def join(self, tally: ErrorTally) -> None:
        peaks = [v for v in (self.peak_true_mm, tally.peak_true_mm) if v is not None]
        for item in fields(self):
            if item.name != "peak_true_mm":
                setattr(self, item.name, getattr(self, item.name) + getattr(tally, item.name))
        self.peak_true_mm = max(peaks, default=None)

    def figures(self) -> dict[str, Any]:
        """Return the figures of the report; None where nothing was measured."""
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
        index = int(np.searchsorted(np.cumsum(self.histogram), 0.95 * self.off_dots.n))
        return float(MIN_BIN_MM * BIN_RATIO ** (index + 1))


def ratio(part: float, total: int) -> float | None:
    """Return part / total; None for a total of 0."""
    return part / total if total else None


DOTS_METHOD = "dots"
"""The method's name where there is nothing but dots to follow; its pixels are dots."""
MIN_TRUSTED_DOTS = 0.8  # share located in a trusted frame; by hand, as MIN_CONFIDENT of `result`


@dataclass
class DotTally:
    """Errors of the dots themselves against truth, and numbers of located and lost dots.

    A misidentified dot is off by half the distance of two dots or more.
    """

    errors: Mean = field(default_factory=Mean)
    worst_mm: float = 0.0
    n_found: int = 0
    n_lost: int = 0

    def join(self, tally: DotTally) -> None:
        self.errors += tally.errors
        self.worst_mm = max(self.worst_mm, tally.worst_mm)
        self.n_found += tally.n_found
        self.n_lost += tally.n_lost

    def figures(self) -> dict[str, Any]:
        """Return errors against truth (None on a real rig), and how many were located."""
        return {
            "mean_vs_truth_mm": self.errors.value,
            "max_vs_truth_mm": self.worst_mm if self.errors.n else None,
            "seen": self.n_found,
            "lost": self.n_lost,
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
    def from_record(cls, camera: CameraModel, pattern: dict[str, Any]) -> PatternDots:
        """Read the dots of a pattern's record (a run's `pattern.json`)."""
        dots_mm = np.asarray(pattern.get("dots_mm", []), dtype=float).reshape(-1, 2)
        # Dark on light, where the recipe's dots are nearer to black; else white on colours.
        colour = str((pattern["recipe"].get("dots") or {}).get("colour", "#ffffff"))
        levels = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
        polarity: Polarity = "dark" if sum(levels) < 3 * 128 else "white"
        return cls(camera, dots_mm, float(pattern["dot_diameter_mm"]), polarity)


class DotFollower:
    """Tracks the dots of one press, and counts them."""

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
        """Track the dots in the next frame. Raises SensorError if the first does not show them."""
        observed = self.tracker.update(image)
        n_dots = int(np.isfinite(observed.displacement_px[:, 0]).sum())
        self.tally.n_found += n_dots
        self.tally.n_lost += len(self.rest_px) - n_dots
        return observed

    def add_frame(self, observed: DotObservation, true_px: Field) -> None:
        """Add a frame's errors. true_px: (n, 2) motion of the dots."""
        errors = _lengths(observed.displacement_px - true_px) * self.mm_per_px
        self.tally.errors.add(errors)
        self.tally.worst_mm = max(self.tally.worst_mm, float(errors.max(initial=0.0)))

    def as_method(self, observed: DotObservation, true_px: Field | None) -> ErrorTally:
        """Tally a frame like a method whose pixels are the dots.

        true_px: (n, 2) motion of the dots, None without truth. A located dot is a confident pixel;
        a lost one has no error, so there is no mean error over all.
        """
        share = float(np.isfinite(observed.displacement_px[:, 0]).mean())
        tally = ErrorTally.for_frame(share, share >= MIN_TRUSTED_DOTS, observed.cpu_ms)
        if true_px is not None:
            visible = is_inside(self.rest_px + true_px, *self.shape)
            moved_mm = np.hypot(*true_px.T) * self.mm_per_px
            moving = visible & (moved_mm >= MOVING_MM)
            errors = _lengths((observed.displacement_px - true_px)[moving]) * self.mm_per_px
            tally.add_confident(errors, int(moving.sum()))
            tally.peak_true_mm = float(moved_mm[visible].max()) if visible.any() else None
        return tally

    def flow_errors(
        self, flow_px: NDArray[np.float32], observed: DotObservation
    ) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """The paper's error (k,) mm of flow (h, w, 2) at k located dots; mask of moving ones."""
        off_px = sample_flow(flow_px, self.tracker.first_px) - observed.displacement_px
        moving = np.hypot(*observed.displacement_px.T) * self.mm_per_px >= MOVING_MM
        return _lengths(off_px) * self.mm_per_px, moving[np.isfinite(off_px[:, 0])]


def _lengths(vectors: Field) -> NDArray[Any]:
    """Lengths of the finite ones of vectors (n, 2)."""
    lengths = np.hypot(*vectors.T)
    return lengths[np.isfinite(lengths)]


DOT_MARGIN_PX = 3.0  # decision 0004


@dataclass(frozen=True)
class TrueFrame:
    """True motion of every rest pixel, projected and in-plane, and which of them move.

    moving: (h, w) bool, of the visible pixels. peak_mm: over the visible pixels, None without any.
    """

    flow_px: NDArray[np.float64]
    in_plane_mm: NDArray[np.float64]
    moving: NDArray[np.bool_]
    peak_mm: float | None

    @classmethod
    def from_flow(
        cls,
        flow: NDArray[np.float64],
        in_plane: NDArray[np.float64],
        imaged: NDArray[np.bool_],
        mm_per_px: float,
    ) -> TrueFrame:
        """Find the visible moving pixels of a true flow.

        flow, in_plane: (h, w, 2), px and mm, at every rest pixel. imaged: (h, w) mask.
        """
        h, w = imaged.shape
        y, x = np.mgrid[:h, :w]
        to = np.stack((x + flow[..., 0], y + flow[..., 1]), axis=-1)
        visible = is_inside(to, h, w) & imaged
        # Where a steep flank folds the image, several face points share a pixel.
        clear = imaged & ~folded_pixels(to, imaged.shape)
        if not clear.all():
            column, row = np.rint(to[visible]).astype(int).T
            visible[visible] = clear[row, column]
        length_mm = np.hypot(flow[..., 0], flow[..., 1]) * mm_per_px
        peak = float(length_mm[visible].max()) if visible.any() else None
        return cls(flow, in_plane, visible & (length_mm >= MOVING_MM), peak)

    @staticmethod
    def imaged_pixels(camera: CameraModel) -> NDArray[np.bool_]:
        """Pixels (h, w) that hold an image: a rectified view may exceed that of the lens."""
        if isinstance(camera, Rectified):
            return camera.visible_pixels()
        return np.ones((camera.height_px, camera.width_px), bool)


def off_dots(
    camera: CameraModel, dots_mm: NDArray[np.float64], diameter_mm: float
) -> NDArray[np.bool_]:
    """Mask (h, w) of rest pixels that lie on no dot, with a margin for its blurred edge."""
    import cv2

    radius_px = diameter_mm / 2 / camera.mm_per_px + DOT_MARGIN_PX
    mask = np.ones((camera.height_px, camera.width_px), np.uint8)
    for x, y in camera.rest_px(dots_mm):
        cv2.circle(mask, (round(x), round(y)), int(np.ceil(radius_px)), 0, -1)
    return mask.astype(bool)


def sample_flow(flow: NDArray[Any], px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Flow (h, w, 2) at points (n, 2) px, bilinear; NaN where a point is NaN."""
    from scipy.ndimage import map_coordinates

    finite = np.isfinite(px).all(axis=1)
    samples = np.full(px.shape, np.nan)
    for k in (0, 1):
        samples[finite, k] = map_coordinates(
            flow[..., k], px[finite, ::-1].T, np.float64, order=1, mode="nearest"
        )
    return samples
