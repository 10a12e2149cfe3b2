"""Dense flow between two images, by name."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import cv2
import numpy as np

from ...aliases import Array
from ...errors import InputError, did_you_mean
from .fused import Plane, to_full, to_half
from .fused import RefinementReference as FusedReference
from .image import MIN_SIDE_PX


@dataclass(frozen=True)
class FlowPreset:
    """One named method: what it is, and the library's own options."""

    about: str
    kind: Literal["farneback", "dis", "fused"]
    options: tuple[tuple[str, float], ...] = ()
    dis_preset: int = 0


def _farneback(iterations: int) -> FlowPreset:
    # 5 levels and a window of 13 are the defaults of OpenCV's GPU version, which the paper cites.
    return FlowPreset(
        f"Farneback 2003: 5 levels, window 13, {iterations} iterations",
        "farneback",
        (
            ("pyr_scale", 0.5),
            ("levels", 5),
            ("winsize", 13),
            ("iterations", iterations),
            ("poly_n", 5),
            ("poly_sigma", 1.1),
        ),
    )


FLOW_METHODS: dict[str, FlowPreset] = {
    # The GPU version's 10 iterations, as the paper; 3 (CPU default) cost a third of the time.
    "farneback-paper": _farneback(10),
    "farneback": _farneback(3),
    "dis-ultrafast": FlowPreset(
        "Dense Inverse Search (Kroeger 2016), coarsest and quickest preset",
        "dis",
        dis_preset=cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    ),
    "dis-fast": FlowPreset(
        "Dense Inverse Search, to half resolution",
        "dis",
        dis_preset=cv2.DISOPTICAL_FLOW_PRESET_FAST,
    ),
    "dis-medium": FlowPreset(
        "Dense Inverse Search, finer patches and refinement",
        "dis",
        dis_preset=cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
    ),
    "fused": FlowPreset(
        "Dense Inverse Search at half the size, then inverse-compositional steps",
        "fused",
    ),
}
DEFAULT_METHOD = "fused"


class FlowMethod:
    """One way to find the flow between two grey images.

    name: a key of FLOW_METHODS. Raises InputError for any other.
    """

    def __init__(self, name: str = DEFAULT_METHOD) -> None:
        if name not in FLOW_METHODS:
            raise InputError(
                f"flow method {name!r}: unknown; {did_you_mean(str(name), FLOW_METHODS)}"
            )
        self.name = name
        self.preset = FLOW_METHODS[name]
        self._options: dict[str, Any] = dict(self.preset.options)
        self._dis = (
            cv2.DISOpticalFlow.create(self.preset.dis_preset) if self.preset.kind == "dis" else None
        )

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
        flags = cv2.OPTFLOW_USE_INITIAL_FLOW if start is not None else 0
        return cv2.calcOpticalFlowFarneback(
            ref_gray,
            cur_gray,
            start,
            flags=flags,
            **self._options,
        )


class PreparedReference:
    """A reference image and all that a method computes of it alone; from `FlowMethod.prepare`."""

    def __init__(self, method: FlowMethod, ref_gray: Array) -> None:
        self._method, self._ref = method, ref_gray

    @cached_property
    def _fused(self) -> FusedReference | None:
        # When it is first matched: most frames that could be a reference never are one.
        return FusedReference.of(self._ref) if self._method.preset.kind == "fused" else None

    def to(self, cur_gray: Array, initial: Array | None = None) -> Array:
        """The flow to a current image: as `FlowMethod.between`."""
        _check("current", cur_gray)
        shape = self._ref.shape
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
        return self._method._calc(self._ref, cur_gray, start)


def _check(what: str, image: Array) -> None:
    if image.ndim != 2 or image.dtype != np.uint8:
        raise InputError(
            f"flow: the {what} image is {image.dtype} {image.shape}; "
            "a grey image (h, w) of uint8 is needed"
        )
