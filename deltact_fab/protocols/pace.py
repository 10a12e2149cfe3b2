"""How long a run takes beyond its motion: what its scheduler waits, and what a host costs.

The runner takes its waits from here, so that an estimate and a run have the same.
"""

from __future__ import annotations

from dataclasses import dataclass

LOOK_S = 0.1
"""The firmware's documents ask for at most 10 status reports a second. In lockstep a step goes on
for as long after its last frame, so that the next one does not start when the host is ready."""
ARRIVAL_S = 0.1
"""In lockstep a frame at the end of a move is taken this long after the planned end, not when the
host happens to hear of it: status reports differ in length, by milliseconds."""


@dataclass(frozen=True)
class RigPace:
    """Seconds beyond motion and settling: to connect, for a move, for a step with frames."""

    connect_s: float
    move_s: float
    frames_s: float


LOCKSTEP = RigPace(connect_s=1.3, move_s=ARRIVAL_S, frames_s=LOOK_S)
# A move: median on GRBL 1.1h at 115200 baud. Frames: one period of a camera, a sample, a position.
WALL_CLOCK = RigPace(connect_s=2.0, move_s=0.023, frames_s=0.03)
# The simulated board on a terminal: it does not restart when it is opened, and answers at once.
SIMULATED = RigPace(connect_s=1.2, move_s=0.005, frames_s=0.005)

SEEK_MM_S = 10.0
SWITCHES_S = 2.0


def homing_s(travel_mm: tuple[float, float, float]) -> float:
    """From half the travel away: z first, then x and y together, every switch twice."""
    x, y, z = travel_mm
    return (z + max(x, y)) / 2 / SEEK_MM_S + 2 * SWITCHES_S
