"""Dense flow between two images, by name."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import cv2
import numpy as np

from ...aliases import Array
from ...errors import InputError, did_you_mean
from .fused import Plane, RefinementReference, to_full, to_half
from .image import MIN_SIDE_PX

# Farneback 2003: 5 levels, a window of 13 and 10 iterations are the defaults of OpenCV's GPU
# version, which the paper cites.
_FARNEBACK: dict[str, Any] = {
    "pyr_scale": 0.5, "levels": 5, "winsize": 13, "iterations": 10, "poly_n": 5, "poly_sigma": 1.1,
}  # fmt: skip
# Dense Inverse Search (Kroeger 2016): to half resolution; finer patches and refinement.
_DIS = {
    "dis-fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "dis-medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
}
FUSED = "fused"
"""Dense Inverse Search at half the size, then inverse-compositional steps."""
FLOW_METHODS = ("farneback-paper", *_DIS, FUSED)


class FlowMethod:
    """One way to find the flow between two grey images.

    name: one of FLOW_METHODS. Farneback's last flow is kept, for trackers that share a method ask
    for it again: a summed and a composed one of the same images. Raises InputError for any other
    name.
    """

    def __init__(self, name: str = FUSED) -> None:
        if name not in FLOW_METHODS:
            raise InputError(
                f"flow method {name!r}: unknown; {did_you_mean(str(name), FLOW_METHODS)}"
            )
        self.name = name
        self._dis = cv2.DISOpticalFlow.create(_DIS[name]) if name in _DIS else None
        self._last: tuple[list[bytes | None], Array] | None = None

    def between(self, ref_gray: Array, cur_gray: Array, initial: Array | None = None) -> Array:
        """Flow from the reference to the current image at the reference's pixels.

        ref_gray, cur_gray: (h, w) uint8; initial: (h, w, 2) px to start from, or None for a cold
        start. Returns (h, w, 2) float32 px, never the array given as initial. Raises InputError
        for shapes or types that do not fit.
        """
        return self.prepare(ref_gray).to(cur_gray, initial)

    def prepare(self, ref_gray: Array) -> PreparedReference:
        """A reference image (h, w) uint8 that many images are matched to; it must not change.

        Raises InputError for another shape or type.
        """
        _check("reference", ref_gray)
        if min(ref_gray.shape) < MIN_SIDE_PX:
            raise InputError(
                f"flow: the image is {ref_gray.shape}; sides of {MIN_SIDE_PX} px or more are needed"
            )
        return PreparedReference(self, ref_gray)

    def _calc(self, ref_gray: Array, cur_gray: Array, start: Any) -> Array:
        if self._dis is not None:
            return self._dis.calc(ref_gray, cur_gray, start)
        key = [None if one is None else one.tobytes() for one in (ref_gray, cur_gray, start)]
        if self._last is None or self._last[0] != key:
            flags = cv2.OPTFLOW_USE_INITIAL_FLOW if start is not None else 0
            flow = cv2.calcOpticalFlowFarneback(
                ref_gray, cur_gray, start, flags=flags, **_FARNEBACK
            )
            self._last = key, flow
        return self._last[1]


class PreparedReference:
    """A reference image and all that a method computes of it alone; from `FlowMethod.prepare`."""

    def __init__(self, method: FlowMethod, ref_gray: Array) -> None:
        self._method, self.gray = method, ref_gray

    @cached_property
    def _fused(self) -> RefinementReference | None:
        # When it is first matched: most frames that could be a reference never are one.
        return RefinementReference(Plane.of(self.gray)) if self._method.name == FUSED else None

    def to(self, cur_gray: Array, initial: Array | None = None) -> Array:
        """The flow to a current image: as `FlowMethod.between`."""
        _check("current", cur_gray)
        shape = self.gray.shape
        if cur_gray.shape != shape:
            raise InputError(
                f"flow: the images are {shape} and {cur_gray.shape}; one size is needed"
            )
        if initial is not None and initial.shape != (*shape, 2):
            raise InputError(f"flow: the initial flow is {initial.shape}, not {(*shape, 2)}")
        if self._fused is not None:
            nodes = None if initial is None else to_half(initial)
            return to_full(self._fused.refine(Plane.of(cur_gray), nodes).flow_px, shape)
        # The others write into the array they start from, and need it contiguous.
        start = None if initial is None else np.array(initial, dtype=np.float32, order="C")
        return self._method._calc(self.gray, cur_gray, start)


def _check(what: str, image: Array) -> None:
    if image.ndim != 2 or image.dtype != np.uint8:
        raise InputError(
            f"flow: the {what} image is {image.dtype} {image.shape}; "
            "a grey image (h, w) of uint8 is needed"
        )
