"""The force sensor of a rig file, how it is reached, and what stops the stage."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ...configuration import Place, Table

Force = Annotated[float, Field(gt=0, le=100_000)]  # N
Torque = Annotated[float, Field(gt=0, le=10_000_000)]  # N mm


class NetFTConfig(Table):
    """An ATI Net F/T box on the network."""

    host: str = Field(min_length=1, max_length=253, examples=["192.168.1.1"])
    """Name or address of the box."""
    rdt_port: int = Field(default=49152, ge=1, le=65535)
    """UDP port of its stream of readings."""
    http_port: int = Field(default=80, ge=1, le=65535)
    """TCP port of its settings."""
    serial: str | None = Field(default=None, min_length=1, max_length=64, examples=["FT11564"])
    """Of the transducer, as FT11564; with it, any other one is refused."""
    silent_s: float = Field(default=0.05, ge=0.02, le=10)
    """A box that says nothing for so long has failed, and readings twice as old leave the guard
    blind. What simulates a box on a busy computer needs more."""


class SerialScaleConfig(Table):
    """A scale or load cell that writes lines of numbers to a serial port."""

    port: str = Field(min_length=1, max_length=4096, examples=["/dev/ttyUSB0"])
    """Serial device, as /dev/ttyUSB0."""
    baud: int = Field(default=115200, ge=1200, le=10_000_000)
    """Of the serial port."""
    columns: tuple[Literal["fx", "fy", "fz", "tx", "ty", "tz", "-"], ...] = Field(
        default=("fz",), min_length=1, max_length=32
    )
    """What each number of a line is; "-" is left out, as a time. Words between do not count."""
    unit: Literal["N", "mN", "g", "kg"] = "N"
    """Of the forces that it writes."""
    torque_unit: Literal["Nmm", "Nm"] = "Nmm"
    """Of the torques that it writes."""
    scale: float = Field(default=1.0, ge=-1e6, le=1e6)
    """Times each number. A press has Fz < 0, so a scale that shows it as positive needs -1."""
    silent_s: float = Field(default=0.5, ge=0.02, le=10)
    """A scale that says nothing for so long has failed."""
    ask: str | None = Field(
        default=None, max_length=80, pattern=r"^[\x00-\x7f]*$", examples=["SIR\r\n"]
    )
    """What makes it write, for a scale that has to be asked, as "SIR\\r\\n"."""

    @model_validator(mode="after")
    def _axes(self) -> Self:
        axes = [name for name in self.columns if name != "-"]
        if not axes or len(set(axes)) < len(axes):
            raise ValueError("columns: each axis once, at least one, and '-' for what is left out")
        if self.scale == 0:
            raise ValueError("scale: 0 leaves nothing of a force; -1 turns its sign")
        return self


class ForceConfig(Table):
    """A six-axis force sensor.

    The defaults serve the simulated box; `preflight` takes what a rig file does not write down for
    undeclared.
    """

    range_n: tuple[Force, Force, Force] = (25.0, 25.0, 35.0)
    """Most force that it measures along x, y, z, as on its calibration sheet; a press is refused
    without it. ATI Nano17 SI-25-0.25 (FT8577): 25, 25, 35; SI-50-0.5 (FT11564): 50, 50, 70."""
    range_nmm: tuple[Torque, Torque, Torque] = (250.0, 250.0, 250.0)
    """Most torque that it measures about x, y, z. SI-25-0.25: 250; SI-50-0.5: 500."""
    origin_mm: tuple[Place, Place, Place] | None = Field(default=None, examples=[[0.0, 0.0, -30.0]])
    """Where its moments count from, in the sensor frame of the gel (below the gel z < 0). MEASURE
    with a rule; without it no moment of a press is predicted."""
    rate_hz: float = Field(default=1000.0, ge=1, le=10_000)
    """Readings per second."""
    netft: NetFTConfig | None = None
    """How a real rig reaches it: an ATI Net F/T box on the network."""
    serial: SerialScaleConfig | None = Field(
        default=None, json_schema_extra={"instead_of": "netft"}
    )

    @property
    def reachable(self) -> bool:
        """Whether it is said how the sensor is read."""
        return self.netft is not None or self.serial is not None

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if self.netft is not None and self.serial is not None:
            raise ValueError("one sensor has one way to it: give [force.netft] or [force.serial]")
        return self


class GuardConfig(Table):
    """Beyond any of these the guard stops the stage, whatever it is doing. What is not set is 80 %
    of the force sensor's range.

    See `guard.GuardLimits`.
    """

    force_n: Force | None = Field(default=None, examples=[15.0])
    """On any axis, of either sign."""
    axes_n: tuple[Force, Force, Force] | None = Field(
        default=None, examples=[[15.0, 15.0, 25.0]], json_schema_extra={"instead_of": "force_n"}
    )
    """On each axis, instead of force_n."""
    resultant_n: Force | None = Field(default=None, examples=[25.0])
    """Of the whole force."""
    torque_nmm: Torque | None = Field(default=None, examples=[200.0])
    """On any axis, about the sensor's own origin."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        if self.force_n is not None and self.axes_n is not None:
            raise ValueError("force_n is for all axes, axes_n for each: give one of them")
        return self
