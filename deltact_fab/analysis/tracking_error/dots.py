"""The dots of one press: what the flow is compared with, and their own error."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...aliases import Points
from ...measure.compose import inside
from ...measure.dots import DotTracker, Polarity
from ...optics import CameraModel
from .tally import MOVING_MM, ErrorTally, confident_figures, largest

DOTS = "dots"
"""The method's name where there is nothing but dots to follow; its pixels are dots."""
MIN_FOUND_SHARE = 0.8  # of the dots, for a frame to be trusted


@dataclass
class DotTally:
    """Errors of the dots themselves against truth, and how many were lost or taken for another."""

    errors_mm: list[float] = field(default_factory=list)
    seen: int = 0
    lost: int = 0
    swapped: int | None = None
    """Dots found nearer to another dot's true place than to their own; None without truth."""

    def join(self, other: DotTally) -> None:
        """Count in another part of the run."""
        self.errors_mm += other.errors_mm
        self.seen += other.seen
        self.lost += other.lost
        if other.swapped is not None:
            self.swapped = (self.swapped or 0) + other.swapped

    def figures(self) -> dict[str, Any]:
        """Errors against truth (None on a real rig), and how many were seen."""
        e = np.asarray(self.errors_mm)
        return {
            "mean_vs_truth_mm": float(e.mean()) if e.size else None,
            "p95_vs_truth_mm": float(np.percentile(e, 95)) if e.size else None,
            "max_vs_truth_mm": float(e.max()) if e.size else None,
            "seen": self.seen,
            "lost": self.lost,
            "swapped": self.swapped,
        }


@dataclass(frozen=True)
class DotFrame:
    """The dots of one frame: where they were first and how far they have moved, (n, 2) px.

    NaN where lost; cpu_ms of finding them.
    """

    first_px: Points
    moved_px: Points
    cpu_ms: float

    @property
    def found(self) -> NDArray[np.bool_]:
        """(n,) which dots are known in both images."""
        return np.isfinite(self.moved_px[:, 0])


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

    def follow(self, image: NDArray[np.uint8]) -> DotFrame:
        """The dots of the next frame. Raises SensorError when the first one does not show them."""
        seen = self.tracker.update(image)
        frame = DotFrame(self.tracker.first_px, seen.displacement_px, seen.cpu_ms)
        self.tally.seen += int(frame.found.sum())
        self.tally.lost += int((~frame.found).sum())
        return frame

    def take(self, frame: DotFrame, true_px: Points) -> None:
        """Count a frame's errors in. true_px: (n, 2) motion of the dots, NaN where not known."""
        known = frame.found & np.isfinite(true_px[:, 0])
        errors = np.linalg.norm((frame.moved_px - true_px)[known], axis=1) * self.mm_per_px
        self.tally.errors_mm += errors.tolist()
        places = frame.first_px + true_px
        at = (frame.first_px + frame.moved_px)[known]
        apart = np.hypot(*(at[:, None] - places[None]).transpose(2, 0, 1))
        nearest = np.nan_to_num(apart, nan=np.inf).argmin(axis=1)
        swapped = int((nearest != np.flatnonzero(known)).sum())
        self.tally.swapped = (self.tally.swapped or 0) + swapped

    def as_method(
        self, tally: ErrorTally, frame: DotFrame, true_px: Points | None
    ) -> dict[str, Any]:
        """Count a frame as that of a method whose pixels are the dots; its figures.

        true_px: (n, 2) motion of the dots, None where no truth is known. A dot that is found is a
        confident pixel; one that is lost has no error, so that there is none over all of them.
        """
        found = frame.found
        share = float(found.mean())
        tally.ms.append(frame.cpu_ms)
        tally.believed.take(share)
        tally.bad_frames += share < MIN_FOUND_SHARE
        figures: dict[str, Any] = {
            "confident_share": share,
            "trusted": share >= MIN_FOUND_SHARE,
            "ms": frame.cpu_ms,
        }
        if true_px is None:
            return figures
        visible = inside(self.rest_px + true_px, *self.shape)
        moved_mm = np.hypot(*true_px.T) * self.mm_per_px
        moving = visible & (moved_mm >= MOVING_MM)
        peak = float(moved_mm[visible].max()) if visible.any() else None
        errors = np.linalg.norm(frame.moved_px - true_px, axis=1)[found & moving] * self.mm_per_px
        n = int(moving.sum())
        tally.take_confident(errors, n)
        tally.peak_true_mm = largest(tally.peak_true_mm, peak)
        return {
            **figures,
            **confident_figures(errors, n),
            "n_moving_px": n,
            "peak_true_mm": peak,
        }
