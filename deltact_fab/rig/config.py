"""A rig file: where the stage stands, what it can do, and what is attached. Nothing is opened.

`kind` decides what a rig is: `virtual` simulates everything below the wire and has the tables of
its simulators under `[virtual]`; `grbl` drives a real controller on `stage.port`. `[stage]` and
`[force]` are the same for both: what the devices are. `[camera]` names what is known of a lens, and
`[virtual.lens]` is the one that a simulated camera has: nothing that estimates may read it.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from .. import catalog, reading
from ..configuration import Table
from ..errors import InputError, did_you_mean
from .simulator import SimulatorConfig
from .tables import CameraConfig, CameraFile, ForceConfig, GuardConfig, StageConfig
from .tool.config import RegistrationFile, ToolConfig, TouchConfig, named_tools

Tools = Annotated[dict[str, ToolConfig], AfterValidator(named_tools)]
TOOLS = {"sphere:10": {"length_mm": 0.0}}


class VirtualConfig(Table):
    """The simulated bench."""

    simulated: ClassVar[bool] = True
    kind: Literal["virtual"]
    """"virtual": everything below the wire is simulated."""
    stage: StageConfig
    force: ForceConfig = ForceConfig()
    camera: CameraFile | None = None
    guard: GuardConfig | None = None
    """What stops the stage; for `rig simulate` only, as are touch and tools."""
    touch: TouchConfig = TouchConfig()
    tools: Tools = Field(default_factory=dict, examples=[TOOLS])
    """By indenter, as `[tools."sphere:10"]`; for `rig simulate` only."""
    virtual: SimulatorConfig = SimulatorConfig()
    served: ClassVar[bool] = False

    @model_validator(mode="after")
    def _lens(self) -> Self:
        if self.camera is not None and self.virtual.lens is None:
            raise ValueError(
                "camera.model: a virtual rig without [virtual.lens] draws through a pinhole, which "
                "needs no calibration; add [virtual.lens] or remove [camera]"
            )
        return self

    def recorded(self) -> dict[str, Any]:
        """What a record keeps: of the true lens no more than whether it is the same."""
        data = self.model_dump(mode="json")
        if self.virtual.lens is not None:
            text = self.virtual.lens.model_dump_json(exclude_none=True)
            data["virtual"]["lens"] = {"sha256": hashlib.sha256(text.encode()).hexdigest()}
        return data


class GrblConfig(Table):
    """A real GRBL stage with what is attached to it."""

    simulated: ClassVar[bool] = False
    kind: Literal["grbl"]
    """"grbl": a real GRBL 1.1 or grblHAL stage."""
    served: bool = False
    """Its devices are simulated ones, served by `rig simulate`, which writes this key: runs say
    so."""
    stage: StageConfig
    force: ForceConfig | None = None
    """A sensor that stands in the way of the force, read or not; every press needs it, for the
    guard lives on it."""
    camera: CameraConfig | None = None
    guard: GuardConfig | None = None
    touch: TouchConfig | None = None
    tools: Tools = Field(default_factory=dict, examples=[TOOLS])
    """By indenter, as `[tools."sphere:10"]`: how much longer it is than the tip that the origin was
    measured with."""

    @model_validator(mode="after")
    def _port(self) -> Self:
        if self.stage.port is None:
            raise ValueError(
                "stage.port: missing key; a 'grbl' rig needs the controller's serial device, as "
                'port = "/dev/ttyACM0"'
            )
        return self

    def recorded(self) -> dict[str, Any]:
        """What a record keeps."""
        return self.model_dump(mode="json")


RigConfig = VirtualConfig | GrblConfig
_KINDS: dict[str, type[VirtualConfig] | type[GrblConfig]] = {
    "virtual": VirtualConfig,
    "grbl": GrblConfig,
}


def load(name: str) -> tuple[RigConfig, Path]:
    """Read a rig by catalogue name or path. Raises InputError."""
    path = catalog.find("protocols/rigs", name)
    data = catalog.read(path)
    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        found = "missing key" if kind is None else f"unknown kind {kind!r}"
        raise InputError(f"{path}: kind: {found}; {did_you_mean(str(kind), _KINDS)}")
    return _registered(catalog.validate(_KINDS[kind], data, str(path)), path), path


def _registered(config: RigConfig, path: Path) -> RigConfig:
    """With the face where it was registered. Raises InputError for a file that is none."""
    if config.stage.registration is None:
        return config
    file = path.parent / config.stage.registration
    if not reading.is_file(file):
        raise InputError(
            f"{path}: stage.registration: {config.stage.registration!r}: no such file in "
            f"{path.parent}; `deltact-fab rig register` writes one"
        )
    found = catalog.validate(RegistrationFile, catalog.read(file), str(file))
    keys = ("origin_machine_mm", "angle_deg", "tilt_deg")
    stage = config.stage.model_copy(update={key: getattr(found, key) for key in keys})
    return config.model_copy(update={"stage": stage})
