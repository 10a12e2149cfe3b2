"""Dense flow between two images, by name."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from ...aliases import Array
from ...errors import InputError, did_you_mean
from .fused import Plane, RefinementReference, to_full, to_half

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
PAPER = "paper"  # the paper's method, Farneback's; alone it is summed, as the paper's tracker
FUSED = "fused"  # Dense Inverse Search at half the size, then inverse-compositional steps
FLOW_METHODS = ("farneback-paper", *_DIS, FUSED)


class FlowMethod:
    """One way to find the flow between two grey images (h, w) uint8 of one size.

    name: PAPER or one of FLOW_METHODS; InputError is raised for any other. What `fused` computes of
    the last reference alone is kept, and so is Farneback's last flow, which trackers that share a
    method ask for again: a summed and a composed one of the same images.
    """

    def __init__(self, name: str = FUSED) -> None:
        if name not in (known := (PAPER, *FLOW_METHODS)):
            raise InputError(f"flow method {name!r}: unknown; {did_you_mean(name, known)}")
        self.name = name = "farneback-paper" if name == PAPER else name
        self._dis = cv2.DISOpticalFlow.create(_DIS[name]) if name in _DIS else None
        self._prepared: tuple[Array, RefinementReference] | None = None
        self._last: tuple[list[bytes | None], Array] | None = None

    def between(self, ref_gray: Array, cur_gray: Array, initial: Array | None = None) -> Array:
        """Flow from the reference to the current image at the reference's pixels.

        ref_gray: must not change between calls. initial: (h, w, 2) px to start from, or None for a
        cold start. Returns (h, w, 2) float32 px, never the array given as initial.
        """
        if self.name == FUSED:
            return self._fused(ref_gray, cur_gray, initial)
        # The others write into the array they start from, and need it contiguous.
        start: Any = None if initial is None else np.array(initial, dtype=np.float32, order="C")
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

    def _fused(self, ref_gray: Array, cur_gray: Array, initial: Array | None) -> Array:
        if self._prepared is None or self._prepared[0] is not ref_gray:
            self._prepared = ref_gray, RefinementReference(Plane.of(ref_gray))
        start = None if initial is None else to_half(initial)
        found = self._prepared[1].refine(Plane.of(cur_gray), start)
        return to_full(found.flow_px, ref_gray.shape)
