"""What the flow of a press is compared with: a frame's truth, and the dots with their error."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...aliases import Points
from ...measure.compose import inside
from ...measure.dots import DotObservation, DotTracker, Polarity
from ...occlusion import in_dispute
from ...optics import CameraModel, Rectified
from .tally import MOVING_MM, ErrorTally, Mean

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
        """Count in another part of the run."""
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
class Marks:
    """The dots of a printed pattern, and the camera whose images are tracked.

    dots_mm: centres at rest, (n, 2); n = 0 without dots.
    """

    camera: CameraModel
    dots_mm: Points
    diameter_mm: float
    polarity: Polarity

    @classmethod
    def of(cls, camera: CameraModel, pattern: dict[str, Any]) -> Marks:
        """pattern: as a run's `pattern.json` has it."""
        dots_mm = np.asarray(pattern.get("dots_mm", []), dtype=float).reshape(-1, 2)
        # Dark on light, where the recipe's dots are nearer to black; else white on colours.
        colour = str((pattern["recipe"].get("dots") or {}).get("colour", "#ffffff"))
        levels = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
        polarity: Polarity = "dark" if sum(levels) < 3 * 128 else "white"
        return cls(camera, dots_mm, float(pattern["dot_diameter_mm"]), polarity)


class DotFollower:
    """Follows the dots of one press, and counts them."""

    def __init__(self, marks: Marks) -> None:
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

    def take(self, seen: DotObservation, true_px: Points) -> None:
        """Count a frame's errors in. true_px: (n, 2) motion of the dots."""
        errors = _lengths(seen.displacement_px - true_px) * self.mm_per_px
        self.tally.errors.take(errors)
        self.tally.worst_mm = max(self.tally.worst_mm, float(errors.max(initial=0.0)))

    def as_method(self, seen: DotObservation, true_px: Points | None) -> ErrorTally:
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


def _lengths(vectors: Points) -> NDArray[Any]:
    """Of those that are known, of vectors (n, 2)."""
    lengths = np.hypot(*vectors.T)
    return lengths[np.isfinite(lengths)]


DOT_MARGIN_PX = 3.0


@dataclass(frozen=True)
class TrueFrame:
    """Projected and in-plane motion of every rest pixel, and which of them move.

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
        to_x, to_y = x + flow[..., 0], y + flow[..., 1]
        visible = (to_x >= 0) & (to_x <= w - 1) & (to_y >= 0) & (to_y <= h - 1)
        # Where a steep flank hides what is behind it, no one point of the face is the true one.
        disputed = in_dispute(np.stack((to_x, to_y), -1), seen.shape)
        ends = np.rint(to_y[visible]).astype(int), np.rint(to_x[visible]).astype(int)
        visible[visible] = seen[visible] & seen[ends] & ~disputed[ends]
        length_mm = np.hypot(flow[..., 0], flow[..., 1]) * mm_per_px
        peak = float(length_mm[visible].max()) if visible.any() else None
        return cls(flow, in_plane, visible & (length_mm >= MOVING_MM), peak)


def seen_by(camera: CameraModel) -> NDArray[np.bool_]:
    """(h, w) the pixels that hold an image: a rectified view may go beyond what the lens saw."""
    if isinstance(camera, Rectified):
        return camera.seen()
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
