"""The force sensor of a rig file, how it is reached, and what stops the stage."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from ..strict import Force, Place, Strict, Torque


class NetFTConfig(Strict):
    """An ATI Net F/T box on the network."""

    host: str = Field(min_length=1, max_length=253)
    rdt_port: int = Field(default=49152, ge=1, le=65535)
    http_port: int = Field(default=80, ge=1, le=65535)
    serial: str | None = Field(default=None, min_length=1, max_length=64)
    """Of the transducer, as FT11564; with it, any other one is refused."""


class SerialScaleConfig(Strict):
    """A scale that writes lines of numbers to a serial port."""

    port: str = Field(min_length=1, max_length=4096)
    baud: int = Field(default=115200, ge=1200, le=10_000_000)


class ForceConfig(Strict):
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
    netft: NetFTConfig | None = None
    """How a real rig reaches it; or serial."""
    serial: SerialScaleConfig | None = None


class GuardConfig(Strict):
    """Beyond any of these the guard stops the stage, whatever it is doing.

    What is not set follows from the sensor's range, see `guard.GuardLimits`.
    """

    force_n: Force | None = None
    """On any axis, of either sign."""
    axes_n: tuple[Force, Force, Force] | None = None
    """On each axis, instead of force_n."""
    resultant_n: Force | None = None
    """Of the whole force."""
    torque_nmm: Torque | None = None
    """On any axis, about the sensor's own origin."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        if self.force_n is not None and self.axes_n is not None:
            raise ValueError("force_n is for all axes, axes_n for each: give one of them")
        return self
