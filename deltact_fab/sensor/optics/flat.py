"""Camera files: the model of a camera, and the flat field beside it.

The flat field is how the light falls off over a camera's image, and makes images as under even
light. Shading multiplies the light; behind a camera's gamma it multiplies the coded values too, so
coded values are divided by those of a frame of a blank skin. It is kept as a 16-bit PNG.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import InputError, RunFailed, did_you_mean, read_toml, toml_text, validate

from .camera import CameraModel, Pinhole
from .fisheye import Fisheye
from .rectified import Rectified

_MODEL_TYPES: dict[str, type[Pinhole | Fisheye | Rectified]] = {
    "pinhole": Pinhole,
    "fisheye": Fisheye,
    "rectified": Rectified,
}


def restore_camera(data: Mapping[str, Any], source: str = "camera") -> CameraModel:
    """The model that `as_dict` wrote; one without a name is from when all were pinholes.

    Raises InputError, with the source in front, for an unknown model or values that are not its.
    """
    values = dict(data)
    name = values.pop("model", "pinhole")
    if not isinstance(name, str) or name not in _MODEL_TYPES:
        raise InputError(f"{source}: model: {name!r}; {did_you_mean(str(name), _MODEL_TYPES)}")
    lens = values.get("lens")
    if name == "rectified" and isinstance(lens, Mapping):
        values["lens"] = {k: v for k, v in lens.items() if k != "model"}
        if lens.get("model", "fisheye") != "fisheye":
            raise InputError(f"{source}: lens.model: {lens['model']!r}; valid: fisheye")
    return validate(_MODEL_TYPES[name], values, source)


def load_camera(path: Path) -> tuple[CameraModel, dict[str, Any]]:
    """The model of a camera file, from its table [camera], and the file's other tables.

    Raises InputError of one line: no such file, no TOML, no such table, a key or a value in it
    that is not the model's.
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
    """The text of a camera file that `load_camera` reads.

    tables: what else it holds, by name, of numbers, strings, booleans, lists and tables of them;
    about: lines of comment above it.
    """
    return toml_text({"camera": camera.as_dict(), **(tables or {})}, about)


BLUR_SHARE = 0.01
"""Sigma of the blur that takes the blank frame's noise away, of its width."""
MAX_FLAT_GAIN = 4.0
"""Where it is darker than that, beyond the skin's window, nothing is to be made bright."""
FULL_16_BIT = 65535
FLAT_REDUCTION = 8
"""Pixels a side that one of the kept image stands for: less than the blur's sigma."""


@dataclass(frozen=True)
class FlatField:
    """Share of the full light that each pixel and channel gets, (h, w, 3) float32 BGR, <= 1."""

    share: NDArray[np.float32]
    most_full: ClassVar[float] = 0.001
    """Share of pixels that may be at the end of their scale before light is lost."""

    @classmethod
    def from_blank(cls, image: NDArray[np.uint8], source: str) -> FlatField:
        """From a frame (h, w, 3) BGR of a blank skin. Raises InputError naming the source."""
        import cv2

        if np.mean(image == 255) > cls.most_full:
            raise InputError(f"{source}: over-exposed; take the blank frame with less light")
        smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), BLUR_SHARE * image.shape[1])
        top = smooth.reshape(-1, 3).max(axis=0)
        if not np.all(top >= 16):
            raise InputError(f"{source}: too dark to tell how the light falls off")
        return cls(np.maximum(smooth / top, np.float32(1 / MAX_FLAT_GAIN)))

    @classmethod
    def load(cls, path: Path, size_px: tuple[int, int]) -> FlatField:
        """From the file that `png` makes, for images of (width, height). Raises InputError."""
        import cv2

        stored = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.is_file() else None
        if stored is None or stored.dtype != np.uint16 or stored.ndim != 3 or not stored.min() > 0:
            raise InputError(f"{path}: not a 16-bit image of the light")
        share = (stored / FULL_16_BIT).astype(np.float32)
        return cls(np.asarray(cv2.resize(share, size_px, interpolation=cv2.INTER_LINEAR)))

    @classmethod
    def from_camera_file(cls, camera_file: Path) -> FlatField | None:
        """The one that a camera file names, None where it names none. Raises InputError."""
        lens, tables = load_camera(camera_file)
        if "flat" not in tables:
            return None
        table = tables["flat"]
        if not (isinstance(table, dict) and isinstance(table.get("file"), str)):
            raise InputError(f"{camera_file}: flat.file: missing; the name of an image beside it")
        try:
            return cls.load(camera_file.parent / table["file"], (lens.width_px, lens.height_px))
        except InputError as error:
            raise InputError(f"{camera_file}: flat.file: {error}") from error

    def to_png(self) -> bytes:
        """As 16-bit PNG, COARSE times smaller, for it is smooth."""
        import cv2

        size = tuple(-(-side // FLAT_REDUCTION) for side in self.share.shape[1::-1])
        coarse = cv2.resize(self.share, size, interpolation=cv2.INTER_AREA)
        success, data = cv2.imencode(".png", np.rint(coarse * FULL_16_BIT).astype(np.uint16))
        if not success:
            raise RunFailed("the flat field could not be encoded as PNG")
        return bytes(data)

    def for_view(self, view: CameraModel) -> FlatField:
        """The same for the images of a view: rectify first, then apply, which is cheaper."""
        import cv2

        if not isinstance(view, Rectified):
            return self

        x, y = view.maps()
        share: Any = cv2.remap(self.share, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return FlatField(np.asarray(share, np.float32))

    def apply(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """An image (h, w, 3) BGR or (h, w) grey as under even light, uint8; full stays full.

        Raises InputError for an image of another size.
        """
        import cv2

        if image.shape[:2] != self.share.shape[:2]:
            raise InputError(
                f"flat field of {self.share.shape[1]} x {self.share.shape[0]} px for an image of "
                f"{image.shape[1]} x {image.shape[0]}"
            )
        share = self.share if image.ndim == 3 else self.share.mean(axis=2)
        return np.asarray(cv2.divide(image, share, dtype=cv2.CV_8U), np.uint8)
