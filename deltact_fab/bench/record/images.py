"""Image files by suffix: lossless encoding and decoding.

PNG is the default. JPEG XL takes a seventh of the time to write and five times as long to read; it
needs the extra `images`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import RunFailed, require_extra

SUSTAINED_RATE_HZ = {"png": 30.0, "jxl": 80.0}
"""Sustained frames per second of 1280 x 720 on two cores: the maximum measured is 35 and 88, and
none of 240 was dropped at 30 and 60 (docs/evidence/bench-timing.md)."""
JPEG_START = b"\xff\xd8"  # ITU-T T.81, table B.1
NOT_AN_IMAGE = "not a readable image"
JXL_EFFORT = 1  # by hand: higher ones save 1 % of size at several times the time

_MEASURED_IMAGE_PX = 1280 * 720  # image of the rates measured above


@dataclass(frozen=True)
class ImageFormat:
    """Image file format of a run. suffix: png or jxl."""

    suffix: str

    @classmethod
    def from_meta(cls, meta: Mapping[str, Any]) -> ImageFormat:
        """Format requested by the rig's camera. meta: of a run, with its rig."""
        camera = (meta.get("rig") or {}).get("camera") or {}
        return cls(str(camera.get("format") or "png"))

    def require(self) -> None:
        """Raise MissingLibrary if the format cannot be written here."""
        if self.suffix == "jxl":
            _imagecodecs()

    def sustained_rate_hz(self, image_px: int) -> float:
        """Frames per second that can be stored without loss, for images of `image_px` pixels."""
        return SUSTAINED_RATE_HZ[self.suffix] * _MEASURED_IMAGE_PX / image_px


def encode(image: NDArray[np.uint8], suffix: str) -> bytes:
    """Encode (h, w, 3) BGR as file bytes, lossless. Raises RunFailed."""
    if suffix == "png":
        return encode_png(image)
    import cv2

    codecs = _imagecodecs()
    rgb = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    try:
        return bytes(codecs.jpegxl_encode(rgb, effort=JXL_EFFORT, lossless=True, numthreads=1))
    except (RuntimeError, ValueError) as error:
        raise RunFailed(f"JPEG XL encoding failed: {error}") from error


def encode_png(image: NDArray[np.uint8]) -> bytes:
    """Encode (h, w, 3) BGR as PNG bytes, tuned for noisy frames (fast filter, Huffman only)."""
    import cv2

    success, data = cv2.imencode(
        ".png",
        image,
        [
            cv2.IMWRITE_PNG_COMPRESSION,
            1,
            cv2.IMWRITE_PNG_STRATEGY,
            cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
            cv2.IMWRITE_PNG_FILTER,
            cv2.IMWRITE_PNG_FILTER_AVG,
        ],
    )
    if not success:
        raise RunFailed("PNG encoding failed")
    return bytes(data)


def decode(data: bytes, name: str) -> NDArray[np.uint8]:
    """Decode file bytes to (h, w, 3) BGR; reads all formats of OpenCV and JPEG XL.

    Raises ValueError with the reason for bytes that are no image of that name's format, or for
    damaged ones; MissingLibrary.
    """
    import cv2

    if PurePath(name).suffix.lower() == ".jxl":
        codecs = _imagecodecs()
        try:
            rgb = codecs.jpegxl_decode(data, numthreads=1)
        except (RuntimeError, ValueError) as error:
            raise ValueError(NOT_AN_IMAGE) from error
        if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8:
            raise ValueError(NOT_AN_IMAGE)
        return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), np.uint8)
    if data.startswith(JPEG_START):
        from .jpeg import IMAGE_END, find_damage

        damage = find_damage(data)
        if damage is not None:
            raise ValueError(f"damaged JPEG: {damage}")
        data += IMAGE_END  # OpenCV requires one
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
    if image is None:
        raise ValueError(NOT_AN_IMAGE)
    return np.asarray(image, np.uint8)


def prepare_jpeg() -> None:
    """Compile the check of JPEG data now (once per installation, 2 to 5 s) for a stream to come."""
    import cv2

    decode(cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes(), "image.jpg")


def _imagecodecs() -> Any:
    require_extra("images", "JPEG XL ([camera] format)", "imagecodecs")
    import imagecodecs

    return imagecodecs
