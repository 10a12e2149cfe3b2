"""A flow without holes: unknown parts are continued from known ones, and stay marked."""

from __future__ import annotations

import cv2
import numpy as np

from .face import FaceFlow
from .flow.fill import filled


def whole(flow: FaceFlow) -> FaceFlow:
    """The same flow with its shift replaced wherever it is not known; finite everywhere.

    There it goes on as planes fitted to the known points around (`flow.fill.filled`), held between
    the least and the largest of the known shifts: nothing lost is given more than was seen. The
    guess that stood there has no say. A point that is not finite, or that moved farther than the
    view is wide, is not known whatever the flow says. With nothing known the shift is 0.
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
