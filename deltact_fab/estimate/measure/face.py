"""What a frame's flow says of the face: the motion of the pattern on a regular grid, in mm.

All that measures shape, force and contact starts here and knows no pixels, no lens and no tracker.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np

from deltact_fab.common import Array
from deltact_fab.sensor import CameraModel, axes_mm

from .compose import filled
from .flow.confidence import FlowObservation, FlowState


@dataclass(frozen=True)
class FaceFlow:
    """The pattern's motion in the view, at points of the resting face; sensor frame.

    shift_mm (h, w, 2) float32: the way of each point's picture, in mm of the resting face, so the
    parallax of its depth is in it. known (h, w) bool: found in the image, or between points that
    were; elsewhere the shift is a guess. x_mm (w,), y_mm (h,): the points, equally spaced by
    cell_mm. trusted: as the tracker says.
    """

    SPACING_PX: ClassVar[int] = 8
    """Between the points on which shape, depth and force rest: depth and contacts rest on cells of
    a millimetre and say no more on finer ones, and the relative depth is smoothed over more."""

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
        """Share of the points whose motion is known."""
        return float(np.count_nonzero(self.known)) / self.known.size

    @classmethod
    def of(cls, seen: FlowObservation, camera: CameraModel, every: int = 1) -> FaceFlow:
        """From a tracker's observation, full or half, of a camera's (rectified) image.

        every: pixels between points, 1, 2, 4, 8 ...; means over every x every pixels, of the known
        ones where there are such, as near the middle of the view as whole cells go. Raises
        ValueError for less than what was observed: 2 of a half observation.
        """
        h, w = seen.flow_px.shape[:2]
        have = 1 if (w, h) == (camera.width_px, camera.height_px) else 2
        if every < have or every % have:
            raise ValueError(f"every: {have} px or a multiple: {every} fails")
        shift, known = seen.flow_px, (seen.state > FlowState.LOST) & seen.visible
        n = every // have
        # A mirror image of the view then gives the mirror image of the points, to half a node.
        rows, columns = (slice(side % n // 2, side % n // 2 + side // n * n) for side in (h, w))
        shift, known = shift[rows, columns], known[rows, columns]
        if n > 1:
            shift, known = _means(shift, known, n)
        x, y = (
            axis[have * cut.start : have * cut.stop].reshape(-1, every).mean(1)
            for axis, cut in zip(axes_mm(camera), (columns, rows), strict=True)
        )
        shift = np.asarray(shift * np.float32(camera.mm_per_px), np.float32)
        return cls(shift, known, x, y, seen.diagnostics.trusted)


def _means(shift: Array, known: Array, n: int) -> tuple[Array, Array]:
    """Over n x n cells: of what is known, of all where that is less than half; and where it is."""
    h, w = (side // n for side in known.shape)
    weight = known[: h * n, : w * n].astype(np.float32)
    share = _mean(weight, (w, h))
    enough, at_least = share >= 0.5, np.maximum(share, np.float32(0.5))
    # A component at a time: numpy is slow along an axis of two.
    parts = cv2.split(np.ascontiguousarray(shift[: h * n, : w * n]))
    whole = [_mean(part, (w, h)) for part in parts]
    if not known.all():
        sums = (_mean(part * weight, (w, h)) for part in parts)
        whole = [np.where(enough, s / at_least, a) for s, a in zip(sums, whole, strict=True)]
    return np.asarray(cv2.merge(whole)), enough


def _mean(values: Array, size: tuple[int, int]) -> Array:
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA))


def whole(flow: FaceFlow) -> FaceFlow:
    """The same flow with its shift replaced wherever it is not known; finite everywhere.

    There it goes on as planes fitted to the known points around (`compose.filled`), held between
    the least and the largest of the known shifts. A point that is not finite, or that moved farther
    than the view is wide, is not known whatever the flow says. With nothing known the shift is 0.
    """
    if isinstance(flow, Whole):
        return flow
    widest_mm = np.hypot(np.ptp(flow.x_mm), np.ptp(flow.y_mm)) + flow.cell_mm
    # A component at a time: numpy is slow along an axis of two.
    x, y = (np.ascontiguousarray(flow.shift_mm[..., k], np.float32) for k in (0, 1))
    known = flow.known & (np.maximum(np.abs(x), np.abs(y)) <= widest_mm)
    if known.all():
        return flow
    part = [np.where(known, a, np.float32(0)) for a in (x, y)]
    if known.any():
        ends = [
            (a.min(where=known, initial=np.inf), a.max(where=known, initial=-np.inf)) for a in part
        ]
        both = cv2.split(filled(cv2.merge(part), known, known))
        part = [np.clip(a, *low_high) for a, low_high in zip(both, ends, strict=True)]
    return Whole(np.asarray(cv2.merge(part)), known, flow.x_mm, flow.y_mm, flow.trusted)


class Whole(FaceFlow):
    """One that `whole` has made; it is not made so again."""


def rigid(flow: FaceFlow) -> tuple[Array, float, Array]:
    """Shift (2,) mm and turn in degrees that best fit the known points, and what is left (n, 2).

    Least squares over x -> R x + t (Kabsch 1976, in the plane). At least one point must be known.
    """
    # As complex numbers x + i y: numpy is slow along an axis of two.
    at = (flow.x_mm + 1j * flow.y_mm[:, None])[flow.known]
    to = at + flow.shift_mm[..., 0][flow.known] + 1j * flow.shift_mm[..., 1][flow.known]
    middle, landed = at.mean(), to.mean()
    a, b = at - middle, to - landed
    turn = np.angle(np.vdot(a, b))
    spun = np.exp(1j * turn)
    shift, left = landed - spun * middle, b - a * spun
    apart = left.view(float).reshape(-1, 2)
    return np.array((shift.real, shift.imag)), float(np.degrees(turn)), apart
