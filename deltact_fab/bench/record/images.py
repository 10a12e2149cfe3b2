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

from .folder import UnsafeFile

SUSTAINED_RATE_HZ = {"png": 30.0, "jxl": 80.0}
"""Sustained frames per second of 1280 x 720 on two cores: the maximum measured is 35 and 88, and
none of 240 was dropped at 30 and 60 (docs/evidence/bench-timing.md)."""
JPEG_START = b"\xff\xd8"  # ITU-T T.81, table B.1
NOT_AN_IMAGE = "not a readable image"
JXL_EFFORT = 1  # by hand: higher ones save 1 % of size at several times the time

MAX_IMAGE_PX = 50_000_000
"""Most pixels of an image that is decoded; by hand: 150 MB, more than any camera in use has."""
# ISO/IEC 18181-1, "AspectRatio": width by height.
_JXL_RATIOS = (1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1)
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

    settings = [cv2.IMWRITE_PNG_COMPRESSION, 1]
    settings += [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
    settings += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_AVG]
    success, data = cv2.imencode(".png", image, settings)
    if not success:
        raise RunFailed("PNG encoding failed")
    return bytes(data)


def decode(data: bytes, name: str) -> NDArray[np.uint8]:
    """Decode file bytes to (h, w, 3) BGR; reads all formats of OpenCV and JPEG XL.

    Raises ValueError with the reason for bytes that are no image of that name's format, or for
    damaged ones; MissingLibrary, and as `require_size`.
    """
    import cv2

    require_size(data, name)
    if PurePath(name).suffix.lower() == ".jxl":
        codecs = _imagecodecs()
        try:
            rgb = codecs.jpegxl_decode(data, index=0, numthreads=1)
        except (RuntimeError, ValueError) as error:
            raise ValueError(NOT_AN_IMAGE) from error
        if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8:
            raise ValueError(NOT_AN_IMAGE)
        return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), np.uint8)
    if data.startswith(JPEG_START):
        from .jpeg import IMAGE_END, find_damage

        if damage := find_damage(data):
            raise ValueError(f"damaged JPEG: {damage}")
        data += IMAGE_END  # OpenCV requires one
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error as error:  # empty, or larger than OpenCV's limit
        raise ValueError(NOT_AN_IMAGE) from error
    if image is None:
        raise ValueError(NOT_AN_IMAGE)
    return np.asarray(image, np.uint8)


def prepare_jpeg() -> None:
    """Compile the check of JPEG data now (once per installation, 2 to 5 s) for a stream to come."""
    import cv2

    decode(cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes(), "image.jpg")


def require_size(data: bytes, source: str) -> None:
    """Raise UnsafeFile for a PNG or JPEG XL of more pixels than MAX_IMAGE_PX."""
    w, h = image_size_px(data) or (0, 0)
    if w * h > MAX_IMAGE_PX:
        limit = f"at most {MAX_IMAGE_PX / 1e6:g} million pixels"
        raise UnsafeFile(f"{source}: image of {w} x {h} px; {limit}")


def image_size_px(data: bytes) -> tuple[int, int] | None:
    """Width and height by the header of a PNG or a bare JPEG XL codestream; None for others."""
    if data[:8] == b"\x89PNG\r\n\x1a\n" and data[12:16] == b"IHDR":
        return int.from_bytes(data[16:20]), int.from_bytes(data[20:24])
    if data[:2] != b"\xff\x0a":
        return None
    bits = int.from_bytes(data[2:14], "little")  # ISO/IEC 18181-1, "SizeHeader"

    def take(n: int) -> int:
        nonlocal bits
        value, bits = bits & (1 << n) - 1, bits >> n
        return value

    by_eight = take(1)

    def side() -> int:
        return 8 * (take(5) + 1) if by_eight else take((9, 13, 18, 30)[take(2)]) + 1

    h, ratio = side(), take(3)
    return (h * _JXL_RATIOS[ratio - 1][0] // _JXL_RATIOS[ratio - 1][1] if ratio else side()), h


def _imagecodecs() -> Any:
    require_extra("images", "JPEG XL ([camera] format)", "imagecodecs")
    import imagecodecs

    return imagecodecs
