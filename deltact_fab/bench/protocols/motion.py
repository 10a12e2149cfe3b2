"""What a stage can do, and how long a run takes: its straight moves, and what its scheduler and a
host add to them. Planning and driving use the same, so that both have the same waits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from deltact_fab.common import Point, Table
from deltact_fab.sensor import StageFrame

PosMm = Annotated[float, Field(ge=-10_000, le=10_000)]  # mm, of a frame or a machine
StageTilt = Annotated[float, Field(ge=-5, le=5)]  # degrees
AxisTravel = Annotated[float, Field(ge=1, le=10_000)]  # mm
MaxFeed = Annotated[float, Field(ge=1, le=100_000)]  # mm/min
Acceleration = Annotated[float, Field(ge=0.1, le=100_000)]  # mm/s2
Force = Annotated[float, Field(gt=0, le=100_000)]  # N

STATUS_INTERVAL_S = 0.1
"""The firmware's documents ask for at most 10 status reports a second. In lockstep a step goes on
for as long after its last frame, so that the next one does not start when the host is ready."""
ARRIVAL_DELAY_S = 0.1
"""In lockstep a frame at the end of a move is taken this long after the planned end, not when the
host happens to hear of it: status reports differ in length, by milliseconds."""


@dataclass(frozen=True)
class RigPace:
    """Seconds beyond motion and settling: to connect, for a move, for a step with frames."""

    connect_s: float
    move_s: float
    frames_s: float


LOCKSTEP_PACE = RigPace(connect_s=1.3, move_s=ARRIVAL_DELAY_S, frames_s=STATUS_INTERVAL_S)
# A move: median on GRBL 1.1h at 115200 baud. Frames: one period of a camera, a sample, a position.
WALL_CLOCK_PACE = RigPace(connect_s=2.0, move_s=0.023, frames_s=0.03)

SEEK_MM_S = 10.0
HOMING_SWITCH_S = 2.0


def add_vectors(a: Point, b: Point) -> Point:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract_vectors(a: Point, b: Point) -> Point:
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def along_line(delta_mm: Point, per_axis: Point) -> float:
    """Largest value along a line that keeps every axis within its own limit."""
    length = math.hypot(*delta_mm)
    return min(
        limit * length / abs(d) for d, limit in zip(delta_mm, per_axis, strict=True) if d != 0
    )


def move_duration_s(
    delta_mm: Point, feed_mm_min: float, max_feed_mm_min: Point, acceleration_mm_s2: Point
) -> float:
    """Time of a straight move from rest to rest, with every axis within its own limits.

    A ramp, a cruise and a ramp; a triangle when the line is too short to reach the feed.
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
    """From half the travel away: z first, then x and y together, every switch twice."""
    x, y, z = travel_mm
    return (z + max(x, y)) / 2 / SEEK_MM_S + 2 * HOMING_SWITCH_S


class StageConfig(Table):
    """The 3-axis stage; machine coordinates are 0 at an axis' positive end and negative below.

    Z homes up, away from the gel; X and Y at 0 too, but for `homing_direction_mask`.
    """

    port: str | None = Field(default=None, min_length=1)
    """Serial device of the controller, as /dev/ttyACM0; a name under /dev/serial/by-id stays the
    same after replugging. The virtual rig has its own wire."""
    origin_machine_mm: tuple[PosMm, PosMm, PosMm] = Field(examples=[[-60.0, -60.0, -40.0]])
    """Where the reference tip meets the centre of the resting face, in machine coordinates.
    MEASURE: home, jog down until the tip just holds a slip of paper, read the position, less the
    paper."""
    angle_deg: float = Field(default=0.0, ge=-360, le=360)
    """How the sensor is turned about z on the stage."""
    tilt_deg: tuple[StageTilt, StageTilt] = (0.0, 0.0)
    """Of the face as it was registered, about the sensor's x, then about y."""
    registration: str | None = Field(
        default=None, min_length=1, max_length=4096, examples=["registration.toml"],
        json_schema_extra={"instead_of": "origin_machine_mm"},
    )  # fmt: skip
    """File that `rig register` wrote, which finds all three by touching the face, from this file's
    folder: it stands for the three above."""
    travel_mm: tuple[AxisTravel, AxisTravel, AxisTravel] = Field(examples=[[120.0, 120.0, 60.0]])
    """How far each axis goes: x, y, z. The controller's own settings must reach at least as far.
    MEASURE: `$$` of GRBL lists it as $130 to $132."""
    max_feed_mm_min: tuple[MaxFeed, MaxFeed, MaxFeed] = Field(examples=[[1500.0, 1500.0, 1200.0]])
    """The fastest that each axis goes; more is never asked for. MEASURE: $110 to $112."""
    acceleration_mm_s2: tuple[Acceleration, Acceleration, Acceleration] = Field(
        examples=[[50.0, 50.0, 50.0]]
    )
    """Acceleration of each axis. MEASURE: $120 to $122."""
    baud: int = Field(default=115200, ge=1200, le=10_000_000)
    """Of the serial port."""
    firmware: Literal["grbl"] = "grbl"
    """What the controller speaks: "grbl" is GRBL 1.1 and grblHAL."""
    direction_mask: int = Field(default=0, ge=0, le=7)
    """Axes whose motor turns the other way (GRBL's $3): 1 for x, 2 for y, 4 for z, added up."""
    homing_direction_mask: int = Field(default=0, ge=0, le=3)
    """Axes with their switch at the negative end (GRBL's $23): 1 for x, 2 for y, added up. Z homes
    up, away from the gel."""
    pull_off_mm: float = Field(default=1.0, gt=0, le=50)
    """How far from its switch homing leaves each axis; nothing goes nearer. MEASURE: $27."""
    homing_s: float | None = Field(default=None, ge=1, le=1000, examples=[30.0])
    """How long homing takes, for estimates; without it reckoned from travel and feeds. MEASURE with
    a watch: `rig home` says it."""
    max_force_n: tuple[Force, Force, Force] | None = Field(
        default=None, examples=[[60.0, 60.0, 60.0]]
    )
    """What the axes can push without losing steps, x, y, z; a press is refused without it. A NEMA
    17 motor with 0.2 N m left at speed, on a screw of 8 mm lead with 40 % efficiency: 2 pi x 0.4 x
    0.2 / 0.008 = 63 N. MEASURE with a scale."""

    @property
    def frame(self) -> StageFrame:
        return StageFrame(self.origin_machine_mm, self.angle_deg, self.tilt_deg)

    @property
    def homed_mm(self) -> tuple[float, float, float]:
        """The ends that it homes to, in machine coordinates."""
        x, y, z = (
            -travel if self.homing_direction_mask >> axis & 1 else 0.0
            for axis, travel in enumerate(self.travel_mm)
        )
        return x, y, z
