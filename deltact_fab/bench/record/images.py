"""Images as files, by the suffix of their names: encoding without loss, and the one reader.

PNG is the default and needs nothing more. JPEG XL takes a seventh of the time to write and five
times as long to read; it comes with the extra `images`.
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
"""Images of 1280 x 720 a second that a run holds on two cores: as fast as they go, 35 and 88 were
seen, and none of 240 was dropped at 30 and at 60 (`python -m benchmarks.recording`)."""
JXL_EFFORT = 1  # higher ones gain a hundredth of the size and cost several times as long

_MEASURED_IMAGE_PX = 1280 * 720


@dataclass(frozen=True)
class ImageFormat:
    """The file format in which a run keeps its images. suffix: of their names, png or jxl."""

    suffix: str

    @classmethod
    def from_meta(cls, meta: Mapping[str, Any]) -> ImageFormat:
        """The format that the camera of a rig asks for; meta: of a run, with its rig."""
        camera = (meta.get("rig") or {}).get("camera") or {}
        return cls(str(camera.get("format") or "png"))

    def require(self) -> None:
        """Raise MissingLibrary when such files cannot be written here."""
        if self.suffix == "jxl":
            _imagecodecs()

    def sustained_rate_hz(self, image_px: int) -> float:
        """Frames of so many pixels a second that can be kept without loss."""
        return SUSTAINED_RATE_HZ[self.suffix] * _MEASURED_IMAGE_PX / image_px


def encode(image: NDArray[np.uint8], suffix: str) -> bytes:
    """(h, w, 3) BGR to the bytes of a file, without loss. Raises RunFailed."""
    if suffix == "png":
        return encode_png(image)
    import cv2

    codecs = _imagecodecs()
    rgb = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    try:
        return bytes(codecs.jpegxl_encode(rgb, effort=JXL_EFFORT, lossless=True, numthreads=1))
    except (RuntimeError, ValueError) as error:
        raise RunFailed(f"an image could not be encoded as JPEG XL: {error}") from error


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
        raise RunFailed("an image could not be encoded as PNG")
    return bytes(data)


def decode(data: bytes, name: str) -> NDArray[np.uint8] | None:
    """(h, w, 3) BGR of the bytes of a file of that name; None when they are no such image.

    Whatever OpenCV knows, and JPEG XL. Raises MissingLibrary.
    """
    import cv2

    if PurePath(name).suffix.lower() == ".jxl":
        codecs = _imagecodecs()
        try:
            rgb = codecs.jpegxl_decode(data, numthreads=1)
        except (RuntimeError, ValueError):
            return None
        if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8:
            return None
        return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), np.uint8)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
    return None if image is None else np.asarray(image, np.uint8)


def _imagecodecs() -> Any:
    require_extra("images", "JPEG XL ([camera] format)", "imagecodecs")
    import imagecodecs

    return imagecodecs
