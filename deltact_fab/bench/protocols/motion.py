"""Limits of a stage and durations of moves, with the delays of scheduler and host; planning and
driving share them, so both have the same waits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from deltact_fab.common import Point, Table
from deltact_fab.sensor import StageFrame

PosMm = Annotated[float, Field(ge=-10_000, le=10_000)]  # in the sensor or the machine frame
StageTilt = Annotated[float, Field(ge=-5, le=5)]  # degrees
AxisTravel = Annotated[float, Field(ge=1, le=10_000)]  # mm
MaxFeed = Annotated[float, Field(ge=1, le=100_000)]  # mm/min
Acceleration = Annotated[float, Field(ge=0.1, le=100_000)]  # mm/s2
Force = Annotated[float, Field(gt=0, le=100_000)]  # N

STATUS_INTERVAL_S = 0.1
"""GRBL's documentation asks for at most 10 status reports per second. In lockstep a step lasts this
long after its last frame, so that the next one does not depend on the host's speed."""
ARRIVAL_DELAY_S = 0.1
"""By hand: in lockstep, delay from the planned end of a move to its last frame. Longer wastes time;
without it the frame would jitter by milliseconds with the length of status reports."""


@dataclass(frozen=True)
class RigPace:
    """Overhead in s besides motion and settling: to connect, per move, per step with frames."""

    connect_s: float
    move_s: float
    frames_s: float


LOCKSTEP_PACE = RigPace(connect_s=1.3, move_s=ARRIVAL_DELAY_S, frames_s=STATUS_INTERVAL_S)
# move_s: median on GRBL 1.1h at 115200 baud. frames_s: camera period, force sample, position.
WALL_CLOCK_PACE = RigPace(connect_s=2.0, move_s=0.023, frames_s=0.03)

STOP_DELAY_S = 0.06
"""Measured on GRBL 1.1h: from the guard's byte to braking; at 1200 mm/min and 100 mm/s2 the way is
2.9 to 3.0 mm, by these figures 3.2."""
UNTOUCHED_STOP_MM = 0.25
"""By hand: longest way of a stop in a descent towards a face that was not touched yet. Shorter is
slower; of a stiff tip's force little is added."""

SEEK_MM_S = 10.0  # by hand: typical homing seek ($25); only scales the estimate
HOMING_SWITCH_S = 2.0  # by hand: second approach and pull-off


def add_vectors(a: Point, b: Point) -> Point:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract_vectors(a: Point, b: Point) -> Point:
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def along_line(delta_mm: Point, per_axis: Point) -> float:
    """Largest speed or acceleration along a line with every axis within its limit."""
    length = math.hypot(*delta_mm)
    return min(
        limit * length / abs(d) for d, limit in zip(delta_mm, per_axis, strict=True) if d != 0
    )


def move_duration_s(
    delta_mm: Point, feed_mm_min: float, max_feed_mm_min: Point, acceleration_mm_s2: Point
) -> float:
    """Duration of a straight move from rest to rest, with every axis within its limits.

    Trapezoidal speed profile; triangular if the line is too short to reach the feed.
    """
    length = math.hypot(*delta_mm)
    if length == 0:
        return 0.0
    accel = along_line(delta_mm, acceleration_mm_s2)
    speed = min(feed_mm_min, along_line(delta_mm, max_feed_mm_min)) / 60
    if speed * speed >= length * accel:
        return 2 * math.sqrt(length / accel)
    return length / speed + speed / accel


def homing_s(travel_mm: tuple[float, float, float]) -> float:
    """Estimated homing time from mid-travel: z, then x and y together, each switch twice."""
    x, y, z = travel_mm
    return (z + max(x, y)) / 2 / SEEK_MM_S + 2 * HOMING_SWITCH_S


class StageConfig(Table):
    """3-axis stage; machine coordinates are 0 at an axis' positive end and negative below.

    Z homes up, away from the gel; X and Y to 0, unless `homing_direction_mask` is set.
    """

    port: str | None = Field(default=None, min_length=1)
    """Serial device of the controller, as /dev/ttyACM0; a name under /dev/serial/by-id stays the
    same after replugging. A virtual rig needs none."""
    origin_machine_mm: tuple[PosMm, PosMm, PosMm] = Field(examples=[[-60.0, -60.0, -40.0]])
    """Machine position of the reference tip in contact with the centre of the resting face.
    MEASURE: home, jog down until the tip just holds a slip of paper, read the position, subtract
    the paper."""
    angle_deg: float = Field(default=0.0, ge=-360, le=360)
    """Rotation of the sensor about z on the stage."""
    tilt_deg: tuple[StageTilt, StageTilt] = (0.0, 0.0)
    """Registered tilt of the face, about the sensor's x, then about y."""
    registration: str | None = Field(
        default=None, min_length=1, max_length=4096, examples=["registration.toml"],
        json_schema_extra={"instead_of": "origin_machine_mm"},
    )  # fmt: skip
    """File written by `rig register`, which finds the three values above by touching the face and
    replaces them; relative to this file."""
    travel_mm: tuple[AxisTravel, AxisTravel, AxisTravel] = Field(examples=[[120.0, 120.0, 60.0]])
    """Travel of each axis: x, y, z. The controller's own settings must allow at least as much.
    MEASURE: `$$` of GRBL lists it as $130 to $132."""
    max_feed_mm_min: tuple[MaxFeed, MaxFeed, MaxFeed] = Field(examples=[[1500.0, 1500.0, 1200.0]])
    """Largest feed of each axis, never exceeded. MEASURE: $110 to $112."""
    acceleration_mm_s2: tuple[Acceleration, Acceleration, Acceleration] = Field(
        examples=[[50.0, 50.0, 50.0]]
    )
    """Acceleration of each axis. MEASURE: $120 to $122."""
    baud: int = Field(default=115200, ge=1200, le=10_000_000)
    """Baud rate of the serial port."""
    firmware: Literal["grbl"] = "grbl"
    """Protocol of the controller: "grbl" is GRBL 1.1 and grblHAL."""
    direction_mask: int = Field(default=0, ge=0, le=7)
    """Axes whose motor turns the other way (GRBL's $3): 1 for x, 2 for y, 4 for z, added up."""
    homing_direction_mask: int = Field(default=0, ge=0, le=3)
    """Axes with their switch at the negative end (GRBL's $23): 1 for x, 2 for y, added up. Z homes
    up, away from the gel."""
    pull_off_mm: float = Field(default=1.0, gt=0, le=50)
    """Distance from its switch at which homing leaves each axis; a limit of moves. MEASURE: $27."""
    homing_s: float | None = Field(default=None, ge=1, le=1000, examples=[30.0])
    """Homing time, for estimates; by default estimated from travel and feeds. MEASURE: `rig home`
    prints it."""
    max_force_n: tuple[Force, Force, Force] | None = Field(
        default=None, examples=[[60.0, 60.0, 60.0]]
    )
    """Force that the axes x, y, z exert without losing steps; required for a press. A NEMA
    17 motor with 0.2 N m left at speed, on a screw of 8 mm lead with 40 % efficiency: 2 pi x 0.4 x
    0.2 / 0.008 = 63 N. MEASURE with a scale."""

    emergency_stop: bool = False
    """True: a latching switch cuts the supply of the motors, within reach and tested. `rig check`
    warns until it is declared."""

    def stopping_mm(self, feed_mm_min: float) -> float:
        """Way along z to rest after a stop is due: STOP_DELAY_S at the feed, then braking."""
        speed = feed_mm_min / 60
        return speed * STOP_DELAY_S + speed**2 / (2 * self.acceleration_mm_s2[2])

    def stop_force_n(self, trip_n: float, feed_mm_min: float, n_per_mm15: float) -> float:
        """Force at rest after a trip of the guard in a descent; F = k d^1.5, Hertz."""
        depth_mm = (trip_n / n_per_mm15) ** (2 / 3) + self.stopping_mm(feed_mm_min)
        return float(n_per_mm15 * depth_mm**1.5)

    @property
    def descent_feed_mm_min(self) -> float:
        """Largest feed towards a face that was not touched yet."""
        accel, delay_s = self.acceleration_mm_s2[2], STOP_DELAY_S
        return 60 * accel * (math.sqrt(delay_s**2 + 2 * UNTOUCHED_STOP_MM / accel) - delay_s)

    @property
    def frame(self) -> StageFrame:
        return StageFrame(self.origin_machine_mm, self.angle_deg, self.tilt_deg)

    @property
    def homed_mm(self) -> tuple[float, float, float]:
        """Machine coordinates of the homing switches."""
        x, y, z = (
            -travel if self.homing_direction_mask >> axis & 1 else 0.0
            for axis, travel in enumerate(self.travel_mm)
        )
        return x, y, z
