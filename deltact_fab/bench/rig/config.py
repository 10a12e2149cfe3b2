"""A rig file: pose and limits of the stage, and the devices attached. Nothing is opened.

`kind` decides what a rig is: `virtual` simulates everything below the wire and has the tables of
its simulators under `[virtual]`; `grbl` drives a real controller on `stage.port`. `[stage]` and
`[force]` describe the devices of both. `[camera]` names the lens calibration; `[virtual.lens]` is
the true lens of a simulated camera, `[virtual.population]` the spread of sensors about their
design, `[virtual.drift]` their change with time: no estimator may read these.
"""

from __future__ import annotations

import hashlib
from dataclasses import fields
from os.path import isfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, get_type_hints

from pydantic import Field, create_model, model_validator

from deltact_fab.common import InputError, Table, did_you_mean, find_file, read_toml, validate
from deltact_fab.sensor import Fisheye, ImageSensor, Printer

from ..protocols.motion import StageConfig, StageTilt
from .tables import (
    CameraConfig,
    CameraFile,
    ForceConfig,
    GuardConfig,
    Monitors,
    RegistrationFile,
    Tools,
    TouchConfig,
)

MountOffset = Annotated[float, Field(ge=-20, le=20)]  # mm
TOOLS_EXAMPLE = {"sphere:10": {"length_mm": 0.0}}  # the format, in help and new files


class NoiseConfig(Table):
    """Noise of the simulated force box."""

    noise_n: float = Field(default=0.01, ge=0, le=100)
    """Standard deviation of a force reading."""


class FiniteGelConfig(Table):
    """Resolution of the simulated gel at the level 'hyperelastic'."""

    cell_mm: float | None = Field(default=None, ge=0.1, le=12.0)
    """Cell size below the indenter; by default chosen from its shape and the tolerance."""
    tolerance: float = Field(default=0.03, ge=0.001, le=0.5)
    """Relative error of force for that choice."""
    most_unknowns: int = Field(default=8_000, ge=500, le=1_000_000)
    """Upper limit for a mesh chosen in this way; larger cells due to it are flagged."""
    lattice_mm: float = Field(default=0.5, ge=0.05, le=2.0)
    """Spacing of the lattice on which displacements are stored."""
    press_increment_mm: float = Field(default=0.5, ge=0.001, le=5.0)
    """Distance pressed between two solutions."""
    shear_increment_mm: float = Field(default=1.0, ge=0.001, le=5.0)
    """Distance dragged between two solutions."""


class GelConfig(Table):
    """Resolution of the simulated gel at the linear level and, separately, at finite strain.

    One solve per increment of motion; between them displacements and forces are interpolated.
    """

    spacing_mm: float | None = Field(default=None, ge=0.05, le=2.0)
    """Spacing of the points at which the linear gel is solved; by default chosen from the contact
    and `hyperelastic.lattice_mm`."""
    press_increment_mm: float = Field(default=0.1, ge=0.001, le=1.0)
    """Distance pressed between two solutions at the linear level."""
    shear_increment_mm: float = Field(default=0.25, ge=0.001, le=2.0)
    """Distance dragged between two solutions at the linear level."""
    hyperelastic: FiniteGelConfig = FiniteGelConfig()


class ObsoleteConfig(Table):
    """Obsolete table of version 0.2 (`run --realtime`): read, and ignored."""

    camera_rate_hz: float = Field(default=5.0, ge=0.1, le=240)
    """Not used."""


class MountConfig(Table):
    """True misalignment of the bench against its rig file, for a touch-off to find.

    For `rig simulate` only: on a virtual rig the rig file is exact.
    """

    offset_mm: tuple[MountOffset, MountOffset, MountOffset] = (0.0, 0.0, 0.0)
    """Offset of the face's centre from `[stage] origin_machine_mm`."""
    tilt_deg: tuple[StageTilt, StageTilt] = (0.0, 0.0)
    """Tilt of the face about the sensor's x, then about y."""
    longer_mm: dict[str, MountOffset] = Field(default_factory=dict)
    """By indenter: its length minus that of the tip that the origin was measured with."""


class _LensChanges(Table):
    """The true lens of a simulated camera: what differs from the design's."""

    design: str | None = None
    """Name or path of the design that these numbers belong to; on another design only differences
    from it apply. Without it they must fit every design that the rig is used with."""

    def numbers(self) -> dict[str, float]:
        """Return the given numbers, without the design."""
        return self.model_dump(exclude={"design"}, exclude_none=True)


if TYPE_CHECKING:
    LensConfig = _LensChanges
else:  # every key of the lens, with the limits and the meaning that it has there
    LensConfig = create_model(
        "LensConfig",
        __base__=_LensChanges,
        **{
            f.name: (get_type_hints(Fisheye)[f.name] | None, Field(None, **f.metadata))
            for f in fields(Fisheye)
        },
    )


class PopulationConfig(Table):
    """Standard deviations between sensors of one design. `--sensor N` draws one of them, within
    three deviations; without it the sensor is the nominal one."""

    modulus: float = Field(default=0.0, ge=0, le=1)
    """Deviation of the gel's modulus, relative (lognormal)."""
    poisson: float = Field(default=0.0, ge=0, le=0.1)
    """Deviation of Poisson's ratio, which stays within the limits of the gel's level."""
    thickness_mm: float = Field(default=0.0, ge=0, le=5)
    """Deviation of the gel's thickness, which also moves the face away from the camera."""
    sticker_mm: float = Field(default=0.0, ge=0, le=5)
    """Deviation of the sticker's place along x, and along y."""
    sticker_deg: float = Field(default=0.0, ge=0, le=10)
    """Deviation of the sticker's turn about its middle."""
    spread_um: float = Field(default=0.0, ge=0, le=100)
    """Deviation of the spread of the ink."""
    light: float = Field(default=0.0, ge=0, le=1)
    """Deviation of the light, relative (lognormal)."""
    camera_mm: float = Field(default=0.0, ge=0, le=2)
    """Deviation of the camera's place along x, and along y."""
    camera_height_mm: float = Field(default=0.0, ge=0, le=2)
    """Deviation of the camera's distance from the face."""
    camera_roll_deg: float = Field(default=0.0, ge=0, le=10)
    """Deviation of the image's rotation."""
    camera_tilt_deg: float = Field(default=0.0, ge=0, le=3)
    """Deviation of the camera's tilt about x, and about y; only with `[virtual.lens]`."""


class DriftConfig(Table):
    """Change of the sensor during a run, by the planned time since the start of the run."""

    force_gain_per_h: float = Field(default=0.0, ge=-100, le=100)
    """Growth of the force sensor's gain, as a share per hour."""
    light_per_h: float = Field(default=0.0, ge=-100, le=100)
    """Growth of the light, as a share per hour."""
    residual: float = Field(default=0.0, ge=0, lt=1)
    """Depth that remains of a press at its end, as a share. It lowers the force of the next press
    near it; images do not show it."""
    recovery_s: float = Field(default=60.0, ge=0.1, le=1e6)
    """Time constant in s, exponential, in which the remaining depth recovers."""


class SimulatorConfig(Table):
    """Settings that only a virtual rig has."""

    camera: ImageSensor = Field(default_factory=ImageSensor)
    lens: LensConfig | None = None
    """Lens of the camera; without it the camera is a pinhole."""
    population: PopulationConfig | None = None
    """Spread of the sensors of one design; without it all are alike."""
    drift: DriftConfig | None = None
    """Change with time; without it nothing changes."""
    printer: Printer = Field(default_factory=Printer)
    force: NoiseConfig = NoiseConfig()
    gel: GelConfig = GelConfig()
    mount: MountConfig = MountConfig()
    realtime: ObsoleteConfig = ObsoleteConfig()


class VirtualConfig(Table):
    """The simulated bench."""

    simulated: ClassVar[bool] = True
    kind: Literal["virtual"]
    """"virtual": everything below the serial link is simulated."""
    stage: StageConfig
    force: ForceConfig = ForceConfig()
    camera: CameraFile | None = None
    guard: GuardConfig | None = None
    """Limits of the force guard; for `rig simulate` only, as are touch and tools."""
    touch: TouchConfig = TouchConfig()
    tools: Tools = Field(default_factory=dict, examples=[TOOLS_EXAMPLE])
    """By indenter, as `[tools."sphere:10"]`; for `rig simulate` only."""
    monitor: Monitors | None = None
    """A number of the surroundings, read once at each press; its limits pause the run."""
    virtual: SimulatorConfig = SimulatorConfig()
    served: ClassVar[bool] = False

    @model_validator(mode="after")
    def _lens(self) -> Self:
        if self.camera is not None and self.virtual.lens is None:
            raise ValueError(
                "camera.model: a virtual rig without [virtual.lens] has a pinhole camera, which "
                "needs no calibration; add [virtual.lens] or remove [camera]"
            )
        population = self.virtual.population
        if population is not None and population.camera_tilt_deg and self.virtual.lens is None:
            raise ValueError(
                "virtual.population.camera_tilt_deg: must be 0 for a pinhole camera (got "
                f"{population.camera_tilt_deg:g}); add [virtual.lens] for a camera that tilts"
            )
        return self

    def recorded(self) -> dict[str, Any]:
        """Return the data for a record; of what is hidden only hashes, to tell a change."""
        data = _dumped(self)
        for name in ("lens", "population", "drift"):
            hidden = getattr(self.virtual, name)
            if hidden is not None:
                text = hidden.model_dump_json(exclude_none=True)
                data["virtual"][name] = {"sha256": hashlib.sha256(text.encode()).hexdigest()}
            elif name != "lens":  # records without these tables stay the same
                del data["virtual"][name]
        return data


class GrblConfig(Table):
    """A real GRBL stage with what is attached to it."""

    simulated: ClassVar[bool] = False
    kind: Literal["grbl"]
    """"grbl": a real GRBL 1.1 or grblHAL stage."""
    served: bool = False
    """True for simulated devices, served by `rig simulate`, which writes this key; runs report
    it."""
    stage: StageConfig
    force: ForceConfig | None = None
    """Sensor in the load path, read or not; every press needs it for the guard."""
    camera: CameraConfig | None = None
    guard: GuardConfig | None = None
    touch: TouchConfig | None = None
    tools: Tools = Field(default_factory=dict, examples=[TOOLS_EXAMPLE])
    """By indenter, as `[tools."sphere:10"]`: its length minus that of the tip that the origin was
    measured with."""
    monitor: Monitors | None = None
    """A number of the surroundings, recorded during a run, with limits that pause it."""

    @model_validator(mode="after")
    def _port(self) -> Self:
        if self.stage.port is None:
            raise ValueError(
                "stage.port: missing key; a 'grbl' rig needs the controller's serial device, as "
                'port = "/dev/ttyACM0"'
            )
        return self

    @property
    def sample_s(self) -> float:
        """Period of the force sensor's readings, 0 without one."""
        source = self.force and (self.force.serial or self.force)
        return 1 / source.rate_hz if source else 0.0

    def recorded(self) -> dict[str, Any]:
        """Return the data for a record."""
        return _dumped(self)


RigConfig = VirtualConfig | GrblConfig
RIG_CONFIGS: dict[str, type[VirtualConfig] | type[GrblConfig]] = {
    "virtual": VirtualConfig,
    "grbl": GrblConfig,
}


def _dumped(rig: RigConfig) -> dict[str, Any]:
    """Return plain data; without monitors, those of a version that had none."""
    return rig.model_dump(mode="json", exclude=None if rig.monitor else {"monitor"})


def load_rig(name: str) -> tuple[RigConfig, Path]:
    """Read a rig by catalogue name or path. Raises InputError."""
    path = find_file("protocols/rigs", name)
    data = read_toml(path)
    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in RIG_CONFIGS:
        problem = "missing key" if kind is None else f"unknown kind {kind!r}"
        raise InputError(f"{path}: kind: {problem}; {did_you_mean(str(kind), RIG_CONFIGS)}")
    return _with_registration(validate(RIG_CONFIGS[kind], data, str(path)), path), path


def _with_registration(config: RigConfig, path: Path) -> RigConfig:
    """Apply the registered position of the face. Raises InputError for an invalid file."""
    if config.stage.registration is None:
        return config
    file = path.parent / config.stage.registration
    if not isfile(file):
        raise InputError(
            f"{path}: stage.registration: {config.stage.registration!r}: no such file in "
            f"{path.parent}; `deltact-fab rig register` writes one"
        )
    registration = validate(RegistrationFile, read_toml(file), str(file))
    keys = ("origin_machine_mm", "angle_deg", "tilt_deg")
    stage = config.stage.model_copy(update={key: getattr(registration, key) for key in keys})
    return config.model_copy(update={"stage": stage})
