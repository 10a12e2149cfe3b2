"""Cameras that are sold (cad/cameras.toml), each a design's section `camera` with its source."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from .. import catalog
from ..errors import InputError, did_you_mean
from .sensor_sections import CameraDimensions


@dataclass(frozen=True)
class CameraModule(CameraDimensions):
    """A camera: its section of a design, and where that was found."""

    source: str = field(default="", metadata={"description": "documents that the figures are from"})

    def section(self) -> CameraDimensions:
        """What a design takes of it."""
        return CameraDimensions(**{f.name: getattr(self, f.name) for f in fields(CameraDimensions)})


@dataclass(frozen=True)
class CameraList:
    """cad/cameras.toml."""

    module: dict[str, CameraModule] = field(default_factory=dict)
    """One `[module.NAME]` table each."""

    __pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # noqa: RUF012


def load_cameras() -> dict[str, CameraModule]:
    """The cameras by name. Raises InputError naming file and key."""
    path = catalog.find("cad", "cameras")
    return catalog.validate(CameraList, catalog.read(path), str(path)).module


def load_camera(name: str) -> CameraDimensions:
    """A camera's section. Raises InputError with the nearest name, and as `load_cameras`."""
    known = load_cameras()
    if name not in known:
        raise InputError(f"--camera {name!r}: no such camera; {did_you_mean(name, known)}")
    return known[name].section()
