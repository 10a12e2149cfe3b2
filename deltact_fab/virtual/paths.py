"""The planned ways of a protocol's presses: known before anything moves.

Straight lines between the tip points of the protocol's steps, each cut into increments; the poses
at their ends are the knots that `gel.path` solves.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..aliases import Point
from ..gel.path.knots import CONTACT_EPS_MM, Increments, KnotPose, divide
from ..protocols.plan import Protocol, expand

REST_GROWTH = 1.5


@dataclass(frozen=True)
class LineMove:
    """A straight way between two tip points (sensor frame), in seconds, and the rest at its end."""

    start_mm: Point
    end_mm: Point
    seconds: float
    dwell_s: float


@dataclass(frozen=True)
class PressPath:
    """The moves of a planned press that end in contact, and its filmed way out of it.

    press: `indenter/position`.
    """

    press: str
    indenter: str
    at_mm: tuple[float, float]
    lines: tuple[LineMove, ...]

    @property
    def waypoints(self) -> tuple[Point, ...]:
        """Ends of the lines, in order, each once."""
        return tuple(dict.fromkeys(p for line in self.lines for p in (line.start_mm, line.end_mm)))

    @property
    def deepest_mm(self) -> float:
        return -min(line.end_mm[2] for line in self.lines)


def paths(protocol: Protocol) -> list[PressPath]:
    """The press paths of a protocol, in its order.

    Ways that end in the air are not in them, but for a retract that is filmed.
    """
    found: dict[str, PressPath] = {}
    here: Point = (0.0, 0.0, protocol.motion.park_mm)
    for step in expand(protocol):
        start, here = here, step.target_mm
        if step.kind == "change":
            continue
        held = found.setdefault(step.press, PressPath(step.press, step.indenter, here[:2], ()))
        if step.kind == "hold":
            *before, last = held.lines
            rests = replace(last, dwell_s=last.dwell_s + step.hold_s)
            found[step.press] = replace(held, lines=(*before, rests))
        elif here[2] < -CONTACT_EPS_MM or (step.kind == "retract" and step.frames):
            seconds = math.dist(start, here) / (step.feed_mm_min / 60)
            line = LineMove(start, here, seconds, step.settle_s)
            found[step.press] = replace(held, lines=(*held.lines, line))
    return list(found.values())


def poses(
    path: PressPath, increments: Increments, relaxing_s: Sequence[float] = ()
) -> list[KnotPose]:
    """All knots of a press that have to be solved, in order.

    relaxing_s: the times in which the gel relaxes; none: it does not, and rests do not count. Else
    a rest is knots more at the same place, see `rest_s`.
    """
    found = []
    for line in path.lines:
        at, where = divide(line.start_mm, line.end_mm, increments)
        for (a, b), tip in zip(itertools.pairwise(at), where[1:], strict=True):
            if tip[2] < 0:
                found.append(KnotPose(tip, (b - a) * line.seconds, b))
        if relaxing_s and line.dwell_s > 0:
            found += [KnotPose(line.end_mm, s, 0.0) for s in rest_s(line.dwell_s, relaxing_s)]
    return found


def rest_s(dwell_s: float, relaxing_s: Sequence[float]) -> list[float]:
    """A rest in parts, each ending REST_GROWTH times as late as the one before.

    The first is at most an eighth of the shortest time of relaxing. Straight lines between the
    ends are off by at most .012 of what a branch of the series gives.
    """
    latest = math.log(8 * dwell_s / min(relaxing_s)) / math.log(REST_GROWTH)
    parts = max(0, math.ceil(latest))
    ends = [dwell_s / REST_GROWTH**k for k in range(parts, -1, -1)]
    return [b - a for a, b in itertools.pairwise([0.0, *ends])]
