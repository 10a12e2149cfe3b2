"""Motion of the pattern on a regular grid of the face, in mm, from the flow of a frame.

Shape, force and contact are computed from it, independent of pixels, lens and tracker.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np

from deltact_fab.common import Array
from deltact_fab.sensor import CameraModel, axes_mm

from .compose import fill_gaps
from .flow.confidence import FlowObservation, FlowState


@dataclass(frozen=True)
class FaceFlow:
    """Motion of the pattern in the view, at points of the resting face; sensor frame.

    shift_mm: (h, w, 2) float32, motion of each point's image in mm of the resting face, including
    the parallax of its depth. known: (h, w) bool, matched in the image or between points that
    were; elsewhere the shift is a guess. x_mm (w,), y_mm (h,): the points, equally spaced by
    cell_mm. trusted: verdict of the tracker.
    """

    SPACING_PX: ClassVar[int] = 8
    """Spacing for shape, depth and force; finer gains nothing (docs/evidence/flow.md)."""

    shift_mm: Array
    known: Array
    x_mm: Array
    y_mm: Array
    trusted: bool = True

    @property
    def cell_mm(self) -> float:
        return float(self.x_mm[1] - self.x_mm[0])

    @property
    def cover(self) -> float:
        """Fraction of the points whose motion is known."""
        return float(np.count_nonzero(self.known)) / self.known.size

    @classmethod
    def from_flow(cls, flow: FlowObservation, camera: CameraModel, spacing_px: int = 1) -> FaceFlow:
        """Convert a tracker's observation, full or half, of a camera's (rectified) image.

        spacing_px: pixels between points, 1, 2, 4, 8 ...; each point is the mean of a square of
        that side, over its known pixels if any; the grid is centred in the view. Raises ValueError
        if finer than the observation (2 for a half one).
        """
        h, w = flow.flow_px.shape[:2]
        node_px = 1 if (w, h) == (camera.width_px, camera.height_px) else 2
        if spacing_px < node_px or spacing_px % node_px:
            raise ValueError(f"spacing_px: {spacing_px}; must be a multiple of {node_px}")
        shift, valid = (flow.flow_px, (flow.state > FlowState.LOST) & flow.visible)
        n = spacing_px // node_px
        # A mirror image of the view then gives the mirror image of the points, to half a node.
        rows, columns = (slice(side % n // 2, side % n // 2 + side // n * n) for side in (h, w))
        shift, valid = shift[rows, columns], valid[rows, columns]
        if n > 1:
            shift, valid = _mean_shifts(shift, valid, n)
        x, y = (
            axis[node_px * cut.start : node_px * cut.stop].reshape(-1, spacing_px).mean(1)
            for axis, cut in zip(axes_mm(camera), (columns, rows), strict=True)
        )
        shift = np.asarray(shift * np.float32(camera.mm_per_px), np.float32)
        return cls(shift, valid, x, y, flow.diagnostics.trusted)


def _mean_shifts(shift: Array, valid: Array, n: int) -> tuple[Array, Array]:
    """Return means over n x n cells, of valid points where at least half are, and that mask."""
    h, w = (side // n for side in valid.shape)
    weight = valid[: h * n, : w * n].astype(np.float32)
    share = _mean(weight, (w, h))
    enough, at_least = share >= 0.5, np.maximum(share, np.float32(0.5))
    # A component at a time: numpy is slow along an axis of two.
    parts = cv2.split(np.ascontiguousarray(shift[: h * n, : w * n]))
    means = [_mean(part, (w, h)) for part in parts]
    if not valid.all():
        sums = (_mean(part * weight, (w, h)) for part in parts)
        means = [np.where(enough, s / at_least, a) for s, a in zip(sums, means, strict=True)]
    return np.asarray(cv2.merge(means)), enough


def _mean(values: Array, size: tuple[int, int]) -> Array:
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA))


def fill_unknown(flow: FaceFlow) -> FaceFlow:
    """Replace the shift wherever it is not known; the result is finite everywhere.

    Gaps get planes fitted to the known points around (`compose.fill_gaps`), clipped to the range
    of the known shifts. A point that is not finite, or that moved farther than the view is wide,
    counts as unknown. With nothing known the shift is 0.
    """
    if isinstance(flow, FilledFaceFlow):
        return flow
    widest_mm = np.hypot(np.ptp(flow.x_mm), np.ptp(flow.y_mm)) + flow.cell_mm
    # A component at a time: numpy is slow along an axis of two.
    x, y = (np.ascontiguousarray(flow.shift_mm[..., k], np.float32) for k in (0, 1))
    valid = flow.known & (np.maximum(np.abs(x), np.abs(y)) <= widest_mm)
    if valid.all():
        return flow
    part = [np.where(valid, a, np.float32(0)) for a in (x, y)]
    if valid.any():
        ends = [
            (a.min(where=valid, initial=np.inf), a.max(where=valid, initial=-np.inf)) for a in part
        ]
        planes = cv2.split(fill_gaps(cv2.merge(part), valid, valid))
        part = [np.clip(a, *low_high) for a, low_high in zip(planes, ends, strict=True)]
    return FilledFaceFlow(np.asarray(cv2.merge(part)), valid, flow.x_mm, flow.y_mm, flow.trusted)


class FilledFaceFlow(FaceFlow):
    """Flow whose gaps are already filled."""


def fit_rigid_motion(flow: FaceFlow) -> tuple[Array, float, Array]:
    """Fit a rigid motion to the known points: shift (2,) mm, turn in degrees, residual (n, 2) mm.

    Least squares over x -> R x + t (Kabsch 1976, in the plane). Needs at least one known point.
    """
    # As complex numbers x + i y: numpy is slow along an axis of two.
    points = (flow.x_mm + 1j * flow.y_mm[:, None])[flow.known]
    targets = points + flow.shift_mm[..., 0][flow.known] + 1j * flow.shift_mm[..., 1][flow.known]
    middle, landed = points.mean(), targets.mean()
    a, b = points - middle, targets - landed
    turn = np.angle(np.vdot(a, b))
    rotation = np.exp(1j * turn)
    shift, residual = landed - rotation * middle, b - a * rotation
    residual_mm = residual.view(float).reshape(-1, 2)
    return np.array((shift.real, shift.imag)), float(np.degrees(turn)), residual_mm
