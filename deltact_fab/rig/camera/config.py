"""The camera of a rig file."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ...configuration import Table

Pixels = Annotated[int, Field(ge=8, le=20_000)]
Control = Annotated[int, Field(ge=-1_000_000, le=1_000_000)]
Word = Annotated[str, Field(min_length=1, max_length=4096)]
DEVICE_FOLDER = "/dev/"
COMMAND = ["gst-launch-1.0", "-q", "nvarguscamerasrc", "!", "...", "!", "fdsink"]
LOCKS = ("exposure", "gain", "white_balance_k", "autofocus")


class CameraFile(Table):
    """What is known of a camera, as it was calibrated."""

    model: Word
    """A camera file, of `deltact-fab calibrate lens`; its path counts from the rig file."""


class CameraConfig(Table):
    """The camera that looks at the gel: how its images come, and how it was calibrated.

    Paths count from the folder of the rig file. Only a V4L2 device's settings can be locked here;
    any other source is told its own where it is started.
    """

    source: Annotated[int, Field(ge=0, le=255)] | Word | None = Field(default=None, examples=[0])
    """N of /dev/videoN or a device file; an rtsp or http address."""
    command: tuple[Word, ...] | None = Field(
        default=None, min_length=1, max_length=256, examples=[COMMAND],
        json_schema_extra={"instead_of": "source"},
    )  # fmt: skip
    """In place of a source: a program and its arguments, as for the camera port of a Jetson. It
    writes images of width_px x height_px to its standard output, BGR of 8 bits, row by row, nothing
    between."""
    stamped: bool = False
    """The command writes 16 bytes before each image, little-endian: int64 nanoseconds of this
    computer's monotonic clock, uint32 number of the image, uint32 that means nothing."""
    width_px: Pixels | None = Field(default=None, examples=[1280])
    """Width of an image, which a device is asked for and a command must say; with height_px."""
    height_px: Pixels | None = Field(default=None, examples=[720])
    """Height of an image; with width_px."""
    rate_hz: float | None = Field(default=None, ge=0.01, le=10_000, examples=[30.0])
    """What a device is asked for, and what missing images are told by."""
    fourcc: str | None = Field(default=None, min_length=4, max_length=4, examples=["MJPG"])
    """Of a V4L2 device: as MJPG or YUYV."""
    exposure: Control | None = Field(default=None, examples=[100])
    """Of a V4L2 device, in units of the driver, 0.1 ms with UVC. The automatic one is off then.
    MEASURE: choose it with the light on and the gel in place; `rig check` says what the device has
    now."""
    gain: Control | None = Field(default=None, examples=[0])
    """Of a V4L2 device, in units of the driver."""
    white_balance_k: Annotated[int, Field(ge=1000, le=20_000)] | None = Field(
        default=None, examples=[4600]
    )
    """Of a V4L2 device: colour temperature; the automatic one is off then."""
    autofocus: bool | None = Field(default=None, examples=[False])
    """Of a V4L2 device: false holds the lens where it is."""
    latency_ms: float = Field(default=0.0, ge=0, le=10_000)
    """From the middle of the exposure to the moment that the image is stamped with."""
    format: Literal["png", "jxl"] = "png"
    """Of the images in the record, both lossless: "png" holds some 45 images of 1280 x 720 a second
    on two cores, "jxl" (extra `images`) some 120."""
    model: Word | None = Field(default=None, examples=["camera.toml"])
    """A camera file, of `deltact-fab calibrate lens`; without one nothing can be tracked."""

    @property
    def is_device(self) -> bool:
        """Whether the source is a V4L2 device."""
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
            raise ValueError("width_px, height_px: missing; a command does not tell its size")
        if self.stamped and self.command is None:
            raise ValueError("stamped: only a command can stamp its images")
        if self.command is None and not self.is_device and "://" not in self.name:
            raise ValueError(
                f"source: {self.name!r} is no camera; valid: N of /dev/videoN, a device file, an "
                "address; images from files are for `measure` and `record import`"
            )
        if not self.is_device:
            only = [key for key in ("fourcc", *LOCKS) if getattr(self, key) is not None]
            if only:
                raise ValueError(
                    f"{', '.join(only)}: only of a V4L2 device, and the source is {self.name}; "
                    "set it where the images come from"
                )
        return self
