"""Raw images to what the tracker reads of the rectified view."""

from __future__ import annotations

import cv2
import numpy as np

from ...aliases import Array
from ...errors import InputError
from ...optics import CameraModel, Rectified
from ..compose import sample
from ..flow import Sampled
from ..flow.fused import to_half


class Rectifier:
    """Takes images of one camera, as its lens makes them or rectified already; maps made once."""

    def __init__(self, camera: CameraModel) -> None:
        self._camera = camera
        self._lens = camera.lens if isinstance(camera, Rectified) else None
        if isinstance(camera, Rectified):
            self._maps = camera.maps()
            self._nodes_px = to_half(np.stack(self._maps, axis=-1))

    @property
    def raw(self) -> bool:
        """Whether images can need it."""
        return self._lens is not None

    def view(self, image: Array) -> Array:
        """The whole rectified image (h, w[, 3]). Raises InputError for a size that is neither."""
        return np.asarray(self._camera.rectify(image)) if self._is_raw(image) else image  # type: ignore[attr-defined]

    def sampled(self, image: Array) -> Array | Sampled:
        """What the tracker reads: a raw colour image's green, and all its channels at the nodes.

        Green is as in `view`. Blue and red, which only witness, are read once a node, which saves
        half of the rectification. Raises as `view`.
        """
        if not self._is_raw(image) or image.ndim != 3 or image.dtype != np.uint8:
            return self.view(image)
        green = cv2.remap(cv2.extractChannel(image, 1), *self._maps, cv2.INTER_CUBIC)
        return Sampled(green, sample(image, self._nodes_px))

    def _is_raw(self, image: Array) -> bool:
        camera, lens, size = self._camera, self._lens, image.shape[1::-1]
        if lens is not None and size == (lens.width_px, lens.height_px):
            return True
        if size == (camera.width_px, camera.height_px):
            return False
        raw = "" if lens is None else f", the lens makes {lens.width_px} x {lens.height_px} px"
        raise InputError(
            f"an image of {size[0]} x {size[1]} px; the view has {camera.width_px} x "
            f"{camera.height_px} px{raw}"
        )
