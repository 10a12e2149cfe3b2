"""A rig file: where the stage stands, what it can do, and what is attached. Nothing is opened.

`kind` decides what a rig is: `virtual` simulates everything below the wire and has the tables of
its simulators under `[virtual]`; `grbl` drives a real controller on `stage.port`. `[stage]` and
`[force]` are the same for both: what the devices are. `[camera]` names what is known of a lens, and
`[virtual.lens]` is the one that a simulated camera has: nothing that estimates may read it.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from .. import catalog
from ..errors import InputError, did_you_mean
from .simulator import SimulatorConfig

if TYPE_CHECKING:
    from ..optics import StageFrame
    from ..protocols.limits import StageBox

# Beyond these no bench goes: what is further out is a slip of the pen.
Place = Annotated[float, Field(ge=-10_000, le=10_000)]  # mm
Travel = Annotated[float, Field(ge=1, le=10_000)]  # mm
Feed = Annotated[float, Field(ge=1, le=100_000)]  # mm/min
Acceleration = Annotated[float, Field(ge=0.1, le=100_000)]  # mm/s2
Force = Annotated[float, Field(gt=0, le=100_000)]  # N
Torque = Annotated[float, Field(gt=0, le=10_000_000)]  # N mm


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class StageConfig(_Strict):
    """The 3-axis stage; machine coordinates are 0 at the homed end and negative below."""

    port: str | None = Field(default=None, min_length=1)
    """Serial device of the controller, as /dev/ttyACM0; the virtual rig has its own wire."""
    origin_machine_mm: tuple[Place, Place, Place]
    angle_deg: float = Field(default=0.0, ge=-360, le=360)
    travel_mm: tuple[Travel, Travel, Travel]
    max_feed_mm_min: tuple[Feed, Feed, Feed]
    acceleration_mm_s2: tuple[Acceleration, Acceleration, Acceleration]
    baud: int = Field(default=115200, ge=1200, le=10_000_000)
    max_force_n: tuple[Force, Force, Force] | None = None
    """What the axes can push without losing steps, x, y, z; None: not declared."""

    @property
    def frame(self) -> StageFrame:
        """The rigid transform of this stage."""
        from ..optics import StageFrame

        return StageFrame(self.origin_machine_mm, self.angle_deg)

    @property
    def box(self) -> StageBox:
        """What the static checks need to know of this stage."""
        from ..protocols.limits import StageBox

        return StageBox(self.frame, self.travel_mm, self.max_feed_mm_min, self.acceleration_mm_s2)


class ForceConfig(_Strict):
    """A six-axis force sensor (ranges as on its calibration sheet).

    ATI Nano17, `max` in the calibration files that come with it: SI-50-0.5 (FT11564) 50, 50, 70 N
    and 500 N mm, SI-25-0.25 (FT8577) 25, 25, 35 N and 250 N mm. The defaults serve the simulated
    box; `preflight` takes what a rig file does not write down for undeclared.
    """

    range_n: tuple[Force, Force, Force] = (25.0, 25.0, 35.0)
    range_nmm: tuple[Torque, Torque, Torque] = (250.0, 250.0, 250.0)
    origin_mm: tuple[Place, Place, Place] | None = None
    """Where its moments count from, in the sensor frame of the gel; None: not declared."""
    rate_hz: float = Field(default=1000.0, ge=1, le=10_000)


class CameraFile(_Strict):
    """The camera that looks at the gel, as it was calibrated."""

    model: str = Field(min_length=1, max_length=4096)
    """A camera file, as `deltact-fab calibrate` writes it; its path counts from the rig file."""


class VirtualConfig(_Strict):
    """The simulated bench."""

    simulated: ClassVar[bool] = True
    kind: Literal["virtual"]
    stage: StageConfig
    force: ForceConfig = ForceConfig()
    camera: CameraFile | None = None
    virtual: SimulatorConfig = SimulatorConfig()

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
            text = json.dumps(self.virtual.lens, sort_keys=True)
            data["virtual"]["lens"] = {"sha256": hashlib.sha256(text.encode()).hexdigest()}
        return data


class GrblConfig(_Strict):
    """A real GRBL stage. No driver of a camera or a force sensor exists yet."""

    simulated: ClassVar[bool] = False
    kind: Literal["grbl"]
    stage: StageConfig
    force: ForceConfig | None = None
    """A sensor that stands in the way of the force, read or not."""

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
_MOVED = ("camera", "printer", "gel")  # simulator's tables that stood beside the real settings


def load(name: str) -> tuple[RigConfig, Path]:
    """Read a rig by catalogue name or path. Raises InputError."""
    path = catalog.find("protocols/rigs", name)
    data = catalog.read(path)
    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        found = "missing key" if kind is None else f"unknown kind {kind!r}"
        raise InputError(f"{path}: kind: {found}; {did_you_mean(str(kind), _KINDS)}")
    _require_new_places(data, kind, str(path))
    if kind == "grbl" and "camera" in data:
        raise InputError(f"{path}: camera: no driver of a camera exists yet for a 'grbl' rig")
    if isinstance(lens := _table(data, "virtual").get("lens"), dict):
        from ..optics import camera_from_dict

        camera_from_dict({**lens, "model": "fisheye"}, f"{path}: virtual.lens")
    return catalog.validate(_KINDS[kind], data, str(path)), path


def _table(data: dict[str, Any], name: str) -> dict[str, Any]:
    found = data.get(name)
    return found if isinstance(found, dict) else {}


def _require_new_places(data: dict[str, Any], kind: str, source: str) -> None:
    """Refuse a file with the simulator's keys where they once stood, saying where each went."""
    moved = [(f"[{table}]", f"[virtual.{table}]") for table in _MOVED if table in data]
    if set(_table(data, "camera")) <= {"model"}:
        moved = [(old, new) for old, new in moved if old != "[camera]"]
    if isinstance(data.get("gel"), dict) and "hyperelastic" in data["gel"]:
        moved.append(("[gel.hyperelastic]", "[virtual.gel.hyperelastic]"))
    if isinstance(data.get("force"), dict) and "noise_n" in data["force"]:
        moved.append(("noise_n of [force]", "noise_n of [virtual.force]"))
    if moved:
        where = ", ".join(f"{old} is now {new}" for old, new in moved)
        of = "" if kind == "virtual" else f"; a {kind!r} rig has none of them"
        raise InputError(
            f"{source}: settings of the simulator have moved, keys unchanged: {where}{of}"
        )
