"""Tables of a rig file common to both kinds: camera, force sensor, guard, touch-off, tools."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from deltact_fab.common import Table

from ..protocols.motion import Force, PosMm, StageTilt
from ..protocols.tables import canonical_indenter

Pixels = Annotated[int, Field(ge=8, le=20_000)]
Control = Annotated[int, Field(ge=-1_000_000, le=1_000_000)]
Word = Annotated[str, Field(min_length=1, max_length=4096)]
DEVICE_FOLDER = "/dev/"
COMMAND_EXAMPLE = ["gst-launch-1.0", "-q", "nvarguscamerasrc", "!", "...", "!", "fdsink"]
LOCKABLE_KEYS = ("exposure", "gain", "white_balance_k", "autofocus")
Torque = Annotated[float, Field(gt=0, le=10_000_000)]  # N mm
Millimetres = Annotated[float, Field(ge=-100, le=100)]


class CameraFile(Table):
    """Calibration of a camera."""

    model: Word
    """Camera file of `deltact-fab calibrate lens`; path relative to the rig file."""


class CameraConfig(Table):
    """Camera behind the gel: image source and calibration.

    Paths are relative to the folder of the rig file. Only settings of a V4L2 device can be locked
    here; any other source is configured where it is started.
    """

    source: Annotated[int, Field(ge=0, le=255)] | Word | None = Field(default=None, examples=[0])
    """N of /dev/videoN or a device file; an rtsp or http address."""
    command: tuple[Word, ...] | None = Field(
        default=None, min_length=1, max_length=256, examples=[COMMAND_EXAMPLE],
        json_schema_extra={"instead_of": "source"},
    )  # fmt: skip
    """Instead of a source: a program and its arguments, as for the camera port of a Jetson. It
    writes images of width_px x height_px to its standard output, BGR of 8 bits, row by row, nothing
    between."""
    stamped: bool = False
    """The command writes 16 bytes before each image, little-endian: int64 nanoseconds of this
    computer's monotonic clock, uint32 number of the image, uint32 unused."""
    width_px: Pixels | None = Field(default=None, examples=[1280])
    """Width of an image: requested from a device, required for a command; with height_px."""
    height_px: Pixels | None = Field(default=None, examples=[720])
    """Height of an image; with width_px."""
    rate_hz: float | None = Field(default=None, ge=0.01, le=10_000, examples=[30.0])
    """Rate requested from a device; missing images are inferred from it."""
    fourcc: str | None = Field(default=None, min_length=4, max_length=4, examples=["MJPG"])
    """Pixel format of a V4L2 device, as MJPG or YUYV."""
    exposure: Control | None = Field(default=None, examples=[100])
    """Exposure of a V4L2 device in units of the driver, 0.1 ms with UVC; turns automatic exposure
    off. MEASURE: choose it with the light on and the gel in place; `rig check` shows the present
    value."""
    gain: Control | None = Field(default=None, examples=[0])
    """Gain of a V4L2 device, in units of the driver."""
    white_balance_k: Annotated[int, Field(ge=1000, le=20_000)] | None = Field(
        default=None, examples=[4600]
    )
    """Colour temperature of a V4L2 device; turns automatic white balance off."""
    autofocus: bool | None = Field(default=None, examples=[False])
    """V4L2 device: false locks the present focus."""
    latency_ms: float = Field(default=0.0, ge=0, le=10_000)
    """Time from the middle of the exposure to the image's time stamp."""
    format: Literal["png", "jxl"] = "png"
    """Format of the images in the record, both lossless: "png" sustains 30 images of 1280 x 720
    per second on two cores, "jxl" (extra `images`) 80."""
    model: Word | None = Field(default=None, examples=["camera.toml"])
    """Camera file of `deltact-fab calibrate lens`; without one images cannot be tracked."""

    @property
    def is_device(self) -> bool:
        """True if the source is a V4L2 device."""
        source = self.source
        return isinstance(source, int) or (source is not None and source.startswith(DEVICE_FOLDER))

    @property
    def name(self) -> str:
        if self.command is not None:
            return self.command[0]
        return f"/dev/video{self.source}" if isinstance(self.source, int) else str(self.source)

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.source is None) == (self.command is None):
            raise ValueError(
                "source: exactly one of source and command is needed, as source = 0 for "
                '/dev/video0, or command = ["gst-launch-1.0", ...]'
            )
        if (self.width_px is None) != (self.height_px is None):
            raise ValueError("width_px, height_px: both or none")
        if self.command is not None and self.width_px is None:
            raise ValueError("width_px, height_px: missing; a command needs them")
        if self.stamped and self.command is None:
            raise ValueError("stamped: only a command can stamp its images")
        if self.command is None and not self.is_device and "://" not in self.name:
            raise ValueError(
                f"source: {self.name!r} is not a camera; valid: N of /dev/videoN, a device file, "
                "an address; images from files are for `measure` and `record import`"
            )
        if not self.is_device:
            only = [key for key in ("fourcc", *LOCKABLE_KEYS) if getattr(self, key) is not None]
            if only:
                raise ValueError(
                    f"{', '.join(only)}: only for a V4L2 device, and the source is {self.name}; "
                    "set it in the program that sends the images"
                )
        return self


class NetFTConfig(Table):
    """An ATI Net F/T box on the network."""

    host: str = Field(min_length=1, max_length=253, examples=["192.168.1.1"])
    """Name or address of the box."""
    rdt_port: int = Field(default=49152, ge=1, le=65535)
    """UDP port of its stream of readings."""
    http_port: int = Field(default=80, ge=1, le=65535)
    """TCP port of its settings."""
    serial: str | None = Field(default=None, min_length=1, max_length=64, examples=["FT11564"])
    """Serial number of the transducer, as FT11564; any other one is refused."""
    silent_s: float = Field(default=0.05, ge=0.02, le=10)
    """Silence after which the box has failed; readings twice as old leave the guard blind. A
    simulated box on a busy computer needs more."""


class SerialScaleConfig(Table):
    """A scale or load cell that writes lines of numbers to a serial port."""

    port: str = Field(min_length=1, max_length=4096, examples=["/dev/ttyUSB0"])
    """Serial device, as /dev/ttyUSB0."""
    baud: int = Field(default=115200, ge=1200, le=10_000_000)
    """Baud rate of the serial port."""
    columns: tuple[Literal["fx", "fy", "fz", "tx", "ty", "tz", "-"], ...] = Field(
        default=("fz",), min_length=1, max_length=32
    )
    """Meaning of each number of a line; "-" is ignored, as a time. Words must be those
    of the first lines."""
    unit: Literal["N", "mN", "g", "kg"] = "N"
    """Unit of the forces that it writes; a line in another one is refused."""
    torque_unit: Literal["Nmm", "Nm"] = "Nmm"
    """Unit of the torques that it writes."""
    scale: float = Field(default=1.0, ge=-1e6, le=1e6)
    """Factor for each number. A press has Fz < 0, so a scale that shows it as positive needs -1."""
    rate_hz: float = Field(default=10.0, ge=0.5, le=10_000)
    """Readings per second, for the planned duration of a run; `rig check` measures them."""
    silent_s: float = Field(default=0.5, ge=0.02, le=10)
    """Silence after which the scale has failed."""
    ask: str | None = Field(
        default=None, max_length=80, pattern=r"^[\x00-\x7f]*$", examples=["SIR\r\n"]
    )
    """Request for a scale that does not write by itself, as "SIR\\r\\n"."""

    @model_validator(mode="after")
    def _axes(self) -> Self:
        axes = [name for name in self.columns if name != "-"]
        if not axes or len(set(axes)) < len(axes):
            raise ValueError("columns: each axis once, at least one, and '-' for ignored numbers")
        if self.scale == 0:
            raise ValueError("scale: must not be 0; -1 changes the sign")
        return self


class MonitorConfig(Table):
    """A number of the surroundings that is recorded during a run, with limits that pause it."""

    name: str = Field(max_length=32, pattern=r"^[a-z][a-z0-9-]*$", examples=["temperature"])
    """Name in records and messages, as temperature, humidity or light."""
    unit: str = Field(default="", max_length=16, examples=["degC"])
    """Unit of its numbers, for people."""
    command: tuple[Word, ...] | None = Field(
        default=None, min_length=1, max_length=256, examples=[["python3", "read_temperature.py"]]
    )
    """A program and its arguments, run in the folder of the rig file for as long as the run. It
    writes lines of one number to its standard output, and flushes each."""
    port: Word | None = Field(
        default=None, examples=["/dev/ttyUSB1"], json_schema_extra={"instead_of": "command"}
    )
    """Serial device that writes such lines; around the number there may be words, the same in
    every line."""
    baud: int = Field(default=115200, ge=1200, le=10_000_000)
    """Baud rate of the port."""
    min: float | None = Field(default=None, ge=-1e9, le=1e9, examples=[20.0])
    """Below it the run pauses before its next press."""
    max: float | None = Field(default=None, ge=-1e9, le=1e9, examples=[26.0])
    """Above it the run pauses before its next press."""
    period_s: float = Field(default=1.0, ge=0, le=3600)
    """Shortest time between two recorded readings; limits apply to every line."""
    silent_s: float = Field(default=10.0, ge=0.1, le=3600)
    """Silence after which its value is unknown."""
    required: bool = True
    """An unknown value pauses the run, too; false: it is only told."""

    @model_validator(mode="after")
    def _source_and_limits(self) -> Self:
        if (self.command is None) == (self.port is None):
            raise ValueError("command: exactly one of command and port is needed")
        if self.min is not None and self.max is not None and self.min >= self.max:
            raise ValueError(f"min: must be below max = {self.max:g} (got {self.min:g})")
        return self


def _distinct_monitors(monitors: tuple[MonitorConfig, ...]) -> tuple[MonitorConfig, ...]:
    names = [monitor.name for monitor in monitors]
    if len(set(names)) < len(names):
        raise ValueError(f"name: each monitor needs its own (got {', '.join(names)})")
    return monitors


Monitors = Annotated[
    tuple[MonitorConfig, ...], Field(max_length=16), AfterValidator(_distinct_monitors)
]


class ForceConfig(Table):
    """A six-axis force sensor.

    The defaults serve the simulated box; for `preflight` a key missing in the rig file is
    undeclared.
    """

    range_n: tuple[Force, Force, Force] = (25.0, 25.0, 35.0)
    """Rated force along x, y, z, from its calibration sheet; a press is refused without it.
    ATI Nano17 SI-25-0.25 (FT8577): 25, 25, 35; SI-50-0.5 (FT11564): 50, 50, 70."""
    range_nmm: tuple[Torque, Torque, Torque] = (250.0, 250.0, 250.0)
    """Rated torque about x, y, z. SI-25-0.25: 250; SI-50-0.5: 500."""
    origin_mm: tuple[PosMm, PosMm, PosMm] | None = Field(default=None, examples=[[0.0, 0.0, -30.0]])
    """Reference point of its moments in the sensor frame of the gel (below the gel z < 0). MEASURE
    with a rule; without it no moment of a press is predicted."""
    rate_hz: float = Field(default=1000.0, ge=1, le=10_000)
    """Readings per second."""
    netft: NetFTConfig | None = None
    """Connection on a real rig: an ATI Net F/T box on the network."""
    serial: SerialScaleConfig | None = Field(
        default=None, json_schema_extra={"instead_of": "netft"}
    )

    @property
    def reachable(self) -> bool:
        """True if a connection to the sensor is given."""
        return self.netft is not None or self.serial is not None

    @model_validator(mode="after")
    def _one_connection(self) -> Self:
        if self.netft is not None and self.serial is not None:
            raise ValueError("give either [force.netft] or [force.serial], not both")
        return self


class GuardConfig(Table):
    """Limits beyond which the guard stops the stage in any state; default: 80 % of the
    force sensor's range.

    See `guard.GuardLimits`.
    """

    force_n: Force | None = Field(default=None, examples=[15.0])
    """Limit on every axis, either sign."""
    axes_n: tuple[Force, Force, Force] | None = Field(
        default=None, examples=[[15.0, 15.0, 25.0]], json_schema_extra={"instead_of": "force_n"}
    )
    """Limit on each axis, instead of force_n."""
    resultant_n: Force | None = Field(default=None, examples=[25.0])
    """Limit of the resultant force."""
    torque_nmm: Torque | None = Field(default=None, examples=[200.0])
    """Limit on every axis, about the sensor's own origin."""

    @model_validator(mode="after")
    def _one_force_limit(self) -> Self:
        if self.force_n is not None and self.axes_n is not None:
            raise ValueError("give either force_n (all axes) or axes_n (each axis), not both")
        return self


class ToolConfig(Table):
    """Declared length of one indenter."""

    length_mm: Millimetres = Field(examples=[0.0])
    """Length minus that of the tip that `[stage] origin_machine_mm` was measured with.
    MEASURE with a caliper; a touch-off corrects it within search_mm."""


class TouchConfig(Table):
    """Touch-off: finds the face after each change of indenter and when a run is resumed.

    Heights are above the expected face: `[stage] origin_machine_mm` plus the length of the
    indenter.
    """

    by: Literal["force"] = "force"
    """Contact is detected by the force sensor."""
    at_mm: tuple[Millimetres, Millimetres] = (0.0, 0.0)
    """Point on the face."""
    force_n: float = Field(default=0.1, ge=0.005, le=5)
    """Force of a contact; at least five standard deviations of the sensor's noise, see `rig
    check`."""
    feed_mm_min: float = Field(default=30.0, ge=1, le=120)
    """Feed of the first approach; the second one is stepwise."""
    clear_mm: float = Field(default=5.0, ge=0.5, le=50)
    """Height at which the approach begins."""
    search_mm: float = Field(default=3.0, ge=0.1, le=20)
    """Search range above and below the expected height; the tip never goes lower."""
    repeats: int = Field(default=3, ge=1, le=20)
    """Number of touches."""
    spread_mm: float = Field(default=0.03, ge=0.001, le=0.5)
    """Largest difference between repeats; more indicates a loose tool."""
    moved_mm: float = Field(default=0.3, ge=0.01, le=5)
    """Largest shift of the face when a run is resumed."""

    @model_validator(mode="after")
    def _heights(self) -> Self:
        if self.clear_mm < self.search_mm:
            raise ValueError(
                f"clear_mm: {self.clear_mm:g} is below search_mm = {self.search_mm:g}; the "
                "approach must begin above the search range"
            )
        return self


class RegisteredTouch(Table):
    """One touch of a registration."""

    at_mm: tuple[Millimetres, Millimetres]
    machine_mm: tuple[PosMm, PosMm, PosMm]
    spread_mm: float = Field(ge=0, le=10)


class RegistrationFile(Table):
    """Result of `rig register`: position of the face for the reference tool.

    residual_mm: largest distance of a touch from the plane, 0 of three touches.
    """

    date: str = Field(max_length=64)
    rig: str = Field(max_length=4096)
    indenter: str = Field(max_length=64)
    by: str = Field(max_length=64)
    origin_machine_mm: tuple[PosMm, PosMm, PosMm]
    angle_deg: float = Field(ge=-360, le=360)
    tilt_deg: tuple[StageTilt, StageTilt]
    residual_mm: float = Field(ge=0, le=10)
    jig_off_mm: tuple[Millimetres, Millimetres] | None = None
    """Only in a file of `rig register --jig`."""
    touches: tuple[RegisteredTouch, ...] = Field(min_length=3, max_length=1000)

    def line(self) -> str:
        """Return a summary for the operator."""
        x, y, z = self.origin_machine_mm
        tx, ty = self.tilt_deg
        flat = f"{self.residual_mm:.3f} mm from flat" if len(self.touches) > 3 else "not checked"
        return (
            f"face at machine ({x:.3f}, {y:.3f}, {z:.3f}) mm, tilted {tx:+.3f} deg about x and "
            f"{ty:+.3f} about y, {flat}, {len(self.touches)} touches"
        )


def _named_tools(tools: dict[str, ToolConfig]) -> dict[str, ToolConfig]:
    """Replace keys by canonical indenter names. Raises ValueError for an unknown one."""
    return {canonical_indenter(name): tool for name, tool in tools.items()}


Tools = Annotated[dict[str, ToolConfig], AfterValidator(_named_tools)]
