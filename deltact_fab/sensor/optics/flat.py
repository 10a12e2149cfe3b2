"""Camera files: camera model and flat field.

The flat field corrects the illumination over the image. Shading multiplies the light, and behind a
camera's gamma also the coded values, so these are divided by those of a frame of a blank skin. It
is stored as a 16-bit PNG.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import InputError, RunFailed, did_you_mean, read_toml, toml_text, validate

from .camera import CameraModel, MovedPinhole, Pinhole
from .fisheye import Fisheye
from .rectified import Rectified

_MODEL_TYPES: dict[str, type[Pinhole | Fisheye | Rectified]] = {
    "pinhole": Pinhole,
    "fisheye": Fisheye,
    "rectified": Rectified,
}


def restore_camera(
    data: Mapping[str, Any], source: str = "camera", true: bool = False
) -> CameraModel:
    """Restore a camera model from `as_dict`; without "model" it is a pinhole (old files).

    true: of a rendering, which may be a moved pinhole; no calibration is.
    Raises InputError prefixed with the source for an unknown model or invalid values.
    """
    values = dict(data)
    name = values.pop("model", "pinhole")
    if true and name == "moved-pinhole":
        return validate(MovedPinhole, values, source)
    if not isinstance(name, str) or name not in _MODEL_TYPES:
        raise InputError(f"{source}: model: {name!r}; {did_you_mean(str(name), _MODEL_TYPES)}")
    lens = values.get("lens")
    if name == "rectified" and isinstance(lens, Mapping):
        values["lens"] = {k: v for k, v in lens.items() if k != "model"}
        if lens.get("model", "fisheye") != "fisheye":
            raise InputError(f"{source}: lens.model: {lens['model']!r}; valid: fisheye")
    return validate(_MODEL_TYPES[name], values, source)


def load_camera(path: Path) -> tuple[CameraModel, dict[str, Any]]:
    """Load the camera model of a file, from its table [camera], and the other tables.

    Raises InputError for a missing or invalid file, table, key or value.
    """
    data = read_toml(path)
    table = data.pop("camera", None)
    if not isinstance(table, dict):
        raise InputError(f'{path}: camera: missing table; [camera] with model = "fisheye" expected')
    if "model" not in table:
        valid = ", ".join(sorted(_MODEL_TYPES))
        raise InputError(f"{path}: camera.model: missing key; valid: {valid}")
    return restore_camera(table, f"{path}: camera"), data


def camera_toml(
    camera: CameraModel, tables: Mapping[str, Any] | None = None, about: Sequence[str] = ()
) -> str:
    """Text of a camera file for `load_camera`.

    tables: further tables by name, of numbers, strings, booleans, lists and tables of them;
    about: comment lines above.
    """
    return toml_text({"camera": camera.as_dict(), **(tables or {})}, about)


BLUR_SHARE = 0.01
"""Blur sigma over image width, removes noise of the blank frame; by hand: more blurs shading."""
MAX_FLAT_GAIN = 4.0
"""By hand: the dark area beyond the skin's window is not brightened further."""
FULL_16_BIT = 65535  # format: 16-bit PNG
FLAT_REDUCTION = 8
"""Reduction of the stored image; by hand: less than the blur's sigma."""


@dataclass(frozen=True)
class FlatField:
    """Relative illumination of each pixel and channel, (h, w, 3) float32 BGR, <= 1."""

    share: NDArray[np.float32]
    max_saturated: ClassVar[float] = 0.001
    """Largest share of saturated pixels in a blank frame."""

    @classmethod
    def from_blank(cls, image: NDArray[np.uint8], source: str) -> FlatField:
        """Create from a frame (h, w, 3) BGR of a blank skin. Raises InputError naming source."""
        import cv2

        if np.mean(image == 255) > cls.max_saturated:
            raise InputError(f"{source}: over-exposed; take the blank frame with less light")
        smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), BLUR_SHARE * image.shape[1])
        top = smooth.reshape(-1, 3).max(axis=0)
        if not np.all(top >= 16):
            raise InputError(f"{source}: too dark to measure the flat field")
        return cls(np.maximum(smooth / top, np.float32(1 / MAX_FLAT_GAIN)))

    @classmethod
    def from_png(cls, data: bytes, source: str, size_px: tuple[int, int]) -> FlatField:
        """Decode the bytes of `to_png`, for images of (width, height). Raises InputError."""
        import cv2

        try:
            stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:  # empty, or larger than OpenCV's limit
            stored = None
        if stored is None or stored.dtype != np.uint16 or stored.ndim != 3 or not stored.min() > 0:
            raise InputError(f"{source}: not a 16-bit flat field image")
        share = (stored / FULL_16_BIT).astype(np.float32)
        return cls(np.asarray(cv2.resize(share, size_px, interpolation=cv2.INTER_LINEAR)))

    @classmethod
    def from_camera_file(cls, camera_file: Path) -> FlatField | None:
        """Load the flat field named in a camera file, or None. Raises InputError."""
        lens, tables = load_camera(camera_file)
        if "flat" not in tables:
            return None
        table = tables["flat"]
        if not (isinstance(table, dict) and isinstance(table.get("file"), str)):
            raise InputError(f"{camera_file}: flat.file: missing; expected an image next to it")
        path = camera_file.parent / table["file"]
        try:
            data = path.read_bytes() if path.is_file() else b""
            return cls.from_png(data, str(path), (lens.width_px, lens.height_px))
        except InputError as error:
            raise InputError(f"{camera_file}: flat.file: {error}") from error

    def to_png(self) -> bytes:
        """Encode as 16-bit PNG, FLAT_REDUCTION times smaller, as it is smooth."""
        import cv2

        size = tuple(-(-side // FLAT_REDUCTION) for side in self.share.shape[1::-1])
        coarse = cv2.resize(self.share, size, interpolation=cv2.INTER_AREA)
        success, data = cv2.imencode(".png", np.rint(coarse * FULL_16_BIT).astype(np.uint16))
        if not success:
            raise RunFailed("flat field: PNG encoding failed")
        return bytes(data)

    def for_view(self, view: CameraModel) -> FlatField:
        """Flat field for the images of a view: rectifying before applying it is cheaper."""
        import cv2

        if not isinstance(view, Rectified):
            return self

        x, y = view.maps()
        share: Any = cv2.remap(self.share, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return FlatField(np.asarray(share, np.float32))

    def apply(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Correct an image (h, w, 3) BGR or (h, w) grey, uint8; saturated pixels stay so.

        Raises InputError for an image of another size.
        """
        import cv2

        if image.shape[:2] != self.share.shape[:2]:
            raise InputError(
                f"flat field of {self.share.shape[1]} x {self.share.shape[0]} px, image of "
                f"{image.shape[1]} x {image.shape[0]}"
            )
        share = self.share if image.ndim == 3 else self.share.mean(axis=2)
        return np.asarray(cv2.divide(image, share, dtype=cv2.CV_8U), np.uint8)
