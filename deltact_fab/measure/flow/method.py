"""Dense flow between two images, by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, did_you_mean

Array = NDArray[Any]

MIN_SIDE_PX = 64  # below it the pyramids of every method degenerate


@dataclass(frozen=True)
class FlowPreset:
    """One named method: what it is, and the library's own options."""

    about: str
    kind: Literal["farneback", "dis"]
    options: tuple[tuple[str, float], ...] = ()
    dis_preset: int = 0


# 5 levels and a window of 13 are the defaults of OpenCV's GPU version, which the paper cites; 3
# iterations (CPU default) instead of its 10 cost a third of the time.
FLOW_METHODS: dict[str, FlowPreset] = {
    "farneback": FlowPreset(
        "Farneback 2003 as in the paper: 5 levels, window 13, 3 iterations",
        "farneback",
        (
            ("pyr_scale", 0.5),
            ("levels", 5),
            ("winsize", 13),
            ("iterations", 3),
            ("poly_n", 5),
            ("poly_sigma", 1.1),
        ),
    ),
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
        "Dense Inverse Search, finer patches and refinement; the default",
        "dis",
        dis_preset=cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
    ),
}
DEFAULT_METHOD = "dis-medium"


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
        for what, image in (("reference", ref_gray), ("current", cur_gray)):
            if image.ndim != 2 or image.dtype != np.uint8:
                raise InputError(
                    f"flow: the {what} image is {image.dtype} {image.shape}; "
                    "a grey image (h, w) of uint8 is needed"
                )
        if ref_gray.shape != cur_gray.shape:
            raise InputError(
                f"flow: the images are {ref_gray.shape} and {cur_gray.shape}; one size is needed"
            )
        if min(ref_gray.shape) < MIN_SIDE_PX:
            raise InputError(
                f"flow: the image is {ref_gray.shape}; sides of {MIN_SIDE_PX} px or more are needed"
            )
        start: Any = None
        if initial is not None:
            if initial.shape != (*ref_gray.shape, 2):
                raise InputError(
                    f"flow: the initial flow is {initial.shape}, not {(*ref_gray.shape, 2)}"
                )
            # Both methods write into the array they start from, and need it contiguous.
            start = np.array(initial, dtype=np.float32, order="C")
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
