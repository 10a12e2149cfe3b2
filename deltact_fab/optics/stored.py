"""Camera models as a record keeps them."""

from __future__ import annotations

from typing import Any

from .. import catalog
from ..errors import InputError, did_you_mean
from .camera import CameraModel
from .pinhole import Pinhole

_MODELS: dict[str, type[Pinhole]] = {"pinhole": Pinhole}


def camera_from_dict(data: dict[str, Any], source: str = "camera") -> CameraModel:
    """The model that `as_dict` wrote; one without a name is from when all were pinholes.

    Raises InputError, with the source in front, for an unknown model or values that are not its.
    """
    values = dict(data)
    name = values.pop("model", "pinhole")
    if name not in _MODELS:
        raise InputError(f"{source}: model: {name!r}; {did_you_mean(str(name), _MODELS)}")
    return catalog.validate(_MODELS[name], values, source)
