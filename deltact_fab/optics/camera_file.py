"""Camera models as a record and a camera file keep them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .. import catalog
from ..errors import InputError, did_you_mean
from .camera import CameraModel, Pinhole
from .fisheye import Fisheye
from .rectified import Rectified

_MODELS: dict[str, type[Pinhole | Fisheye | Rectified]] = {
    "pinhole": Pinhole,
    "fisheye": Fisheye,
    "rectified": Rectified,
}


def camera_from_dict(data: Mapping[str, Any], source: str = "camera") -> CameraModel:
    """The model that `as_dict` wrote; one without a name is from when all were pinholes.

    Raises InputError, with the source in front, for an unknown model or values that are not its.
    """
    values = dict(data)
    name = values.pop("model", "pinhole")
    if not isinstance(name, str) or name not in _MODELS:
        raise InputError(f"{source}: model: {name!r}; {did_you_mean(str(name), _MODELS)}")
    lens = values.get("lens")
    if name == "rectified" and isinstance(lens, Mapping):
        values["lens"] = {k: v for k, v in lens.items() if k != "model"}
        if lens.get("model", "fisheye") != "fisheye":
            raise InputError(f"{source}: lens.model: {lens['model']!r}; valid: fisheye")
    return catalog.validate(_MODELS[name], values, source)


def load_camera(path: Path) -> tuple[CameraModel, dict[str, Any]]:
    """The model of a camera file, from its table [camera], and the file's other tables.

    Raises InputError of one line: no such file, no TOML, no such table, a key or a value in it
    that is not the model's.
    """
    data = catalog.read(path)
    table = data.pop("camera", None)
    if not isinstance(table, dict):
        raise InputError(f'{path}: camera: missing table; [camera] with model = "fisheye" expected')
    if "model" not in table:
        raise InputError(f"{path}: camera.model: missing key; valid: {', '.join(sorted(_MODELS))}")
    return camera_from_dict(table, f"{path}: camera"), data


def as_toml(
    camera: CameraModel, tables: Mapping[str, Any] | None = None, about: Sequence[str] = ()
) -> str:
    """The text of a camera file that `load_camera` reads.

    tables: what else it holds, by name, of numbers, strings, booleans, lists and tables of them;
    about: lines of comment above it.
    """
    return catalog.as_toml({"camera": camera.as_dict(), **(tables or {})}, about)
