"""One press (indenter x position) as its solved knots, and the store that keeps them.

The planned way of a press is known before anything moves: straight lines between the tip points of
the protocol's steps. Each is cut into increments, and the poses at their ends are the knots. What
is solved there depends on gel, indenter, way and mesh alone, so it is kept by the hash of these and
shared by all patterns, cameras, seeds and runs, and by all moduli: forces are in proportion to it.
"""

from __future__ import annotations

import io
import itertools
import json
import math
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import cache
from ..protocols.plan import Protocol, expand

Point = tuple[float, float, float]
Field = NDArray[np.float64]

VERSION = 6
"""Of the code that solves; raise it when solved knots change by more than their tolerance."""
KIND = "gel-trajectory"
KEEP_BYTES = 8 * 10**9
CONTACT_EPS_MM = 1e-9  # rounding of the frame's transform; a motor step is 1e-3


@dataclass(frozen=True)
class Increments:
    """Longest way between two knots, in mm: along the gel's normal and across it."""

    press_mm: float
    shear_mm: float


@dataclass(frozen=True)
class Line:
    """A straight way between two tip points (sensor frame), in seconds, and the rest at its end."""

    start_mm: Point
    end_mm: Point
    seconds: float
    dwell_s: float


@dataclass(frozen=True)
class Pose:
    """Where and when a knot is solved: tip (x, y, z < 0), seconds since the knot before.

    part: the fraction of its line; 0 when the tip has rested since the end of the line before.
    """

    tip_mm: Point
    seconds: float
    part: float


@dataclass(frozen=True)
class PressPath:
    """The planned way of a press: what of it ends in contact. press: `indenter/position`."""

    press: str
    indenter: str
    at_mm: tuple[float, float]
    lines: tuple[Line, ...]

    @property
    def waypoints(self) -> tuple[Point, ...]:
        """Ends of the lines, in order, each once."""
        return tuple(dict.fromkeys(p for line in self.lines for p in (line.start_mm, line.end_mm)))

    @property
    def box_mm(self) -> tuple[tuple[float, float], tuple[float, float], float]:
        """Tip positions in contact, (low, high) in x and in y, and the deepest depth."""
        x, y, z = zip(*(line.end_mm for line in self.lines), strict=True)
        return (min(x), max(x)), (min(y), max(y)), -min(z)


def paths(protocol: Protocol) -> list[PressPath]:
    """The press paths of a protocol, in its order. Ways that end in the air are not in them."""
    found: dict[str, PressPath] = {}
    here: Point = (0.0, 0.0, protocol.motion.park_mm)
    for step in expand(protocol):
        start, here = here, step.target_mm
        if step.kind == "change":
            continue
        held = found.setdefault(step.press, PressPath(step.press, step.indenter, here[:2], ()))
        if here[2] < -CONTACT_EPS_MM:
            seconds = math.dist(start, here) / (step.feed_mm_min / 60)
            line = Line(start, here, seconds, step.settle_s)
            found[step.press] = replace(held, lines=(*held.lines, line))
    return list(found.values())


def divide(start: Point, end: Point, increments: Increments) -> tuple[list[float], list[Point]]:
    """Fractions and points of the knots of a line, one of them exactly at first touch."""
    cuts = [0.0, 1.0]
    if min(start[2], end[2]) < 0 < max(start[2], end[2]):
        cuts.insert(1, start[2] / (start[2] - end[2]))
    at = [0.0]
    for a, b in itertools.pairwise(cuts):
        dx, dy, dz = ((q - p) * (b - a) for p, q in zip(start, end, strict=True))
        z = (start[2] + f * (end[2] - start[2]) for f in (a, b))
        pieces = 1 if max(z) > CONTACT_EPS_MM else max(
            1,
            math.ceil(abs(dz) / increments.press_mm - 1e-9),
            math.ceil(math.hypot(dx, dy) / increments.shear_mm - 1e-9),
        )  # fmt: skip
        at += [a + (b - a) * k / pieces for k in range(1, pieces + 1)]
    where = []
    for f in at:
        x, y, z_mm = (p + f * (q - p) for p, q in zip(start, end, strict=True))
        where.append((x, y, 0.0 if abs(z_mm) < CONTACT_EPS_MM else z_mm))
    return at, where


def poses(path: PressPath, increments: Increments, timed: bool) -> list[Pose]:
    """All knots of a press that have to be solved, in order; timed: rests count, as the gel creeps.

    A rest is one knot more at the same place.
    """
    found = []
    for line in path.lines:
        at, where = divide(line.start_mm, line.end_mm, increments)
        for (a, b), tip in zip(itertools.pairwise(at), where[1:], strict=True):
            if tip[2] < 0:
                found.append(Pose(tip, (b - a) * line.seconds, b))
        if timed and line.dwell_s > 0:
            found.append(Pose(line.end_mm, line.dwell_s, 0.0))
    return found


@dataclass(frozen=True, eq=False)
class Solved:
    """What a scene needs of a solved pose, for a modulus of 1 MPa.

    displacement_mm (ny, nx, 3): on the lattice, None unless asked for. flags: what a reader of the
    results must know of this state.
    """

    force_n: Point
    torque_nmm: Point
    contact_area_mm2: float
    displacement_mm: NDArray[np.float32] | None
    flags: tuple[str, ...]


@dataclass(frozen=True)
class Between:
    """How far linear interpolation was from a solve half-way between knots.

    samples: how many were tried; failed: of them did not converge. displacement_mm: largest, in
    plane (0 where no field is kept). force_n: largest norm, for a modulus of 1 MPa.
    """

    samples: int = 0
    failed: int = 0
    displacement_mm: float = 0.0
    force_n: float = 0.0

    def joined(self, other: Between) -> Between:
        """The worst of both."""
        return Between(
            self.samples + other.samples,
            self.failed + other.failed,
            max(self.displacement_mm, other.displacement_mm),
            max(self.force_n, other.force_n),
        )


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A whole press: its knots in order, the lattice's axes, and how it was made."""

    knots: tuple[Solved, ...]
    x_mm: Field
    y_mm: Field
    between: Between
    seconds: float


def load(key: dict[str, Any], count: int) -> Trajectory | None:
    """The stored trajectory of `count` knots under a key; None where there is no whole one."""
    found = cache.get_file(KIND, _plain(key))
    if found is None:
        return None
    data, note = found
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as held:
            numbers, flags = held["numbers"], note["flags"]
            fields: Iterable[Any] = held["displacement_mm"] if key["fields"] else [None] * count
            x_mm, y_mm = held["x_mm"], held["y_mm"]
        knots = tuple(
            Solved(_point(n[:3]), _point(n[3:6]), float(n[6]), u, tuple(f))
            for n, u, f in zip(numbers, fields, flags, strict=True)
        )
        between = Between(**note["between"])
        seconds = float(note["seconds"])
    except (ValueError, KeyError, TypeError, zipfile.BadZipFile):
        return None
    if len(knots) != count:
        return None
    return Trajectory(knots, x_mm, y_mm, between, seconds)


def keep(key: dict[str, Any], made: Trajectory) -> bool:
    """Store a whole trajectory; False when the folder refuses. The longest unused make room."""
    arrays: dict[str, Any] = {
        "numbers": np.array(
            [(*k.force_n, *k.torque_nmm, k.contact_area_mm2) for k in made.knots]
        ).reshape(-1, 7),
        "x_mm": made.x_mm,
        "y_mm": made.y_mm,
    }
    if key["fields"]:
        shape = (0, len(made.y_mm), len(made.x_mm), 3)
        fields = [k.displacement_mm for k in made.knots if k.displacement_mm is not None]
        arrays["displacement_mm"] = np.stack(fields) if fields else np.zeros(shape, np.float32)
    packed = io.BytesIO()
    np.savez(packed, **arrays)
    note = {
        "flags": [list(k.flags) for k in made.knots],
        "between": asdict(made.between),
        "seconds": made.seconds,
    }
    stored = cache.put_file(KIND, _plain(key), packed.getvalue(), note)
    cache.trim(KIND, KEEP_BYTES)
    return stored


def _plain(key: dict[str, Any]) -> dict[str, Any]:
    """As JSON gives it back: the store compares."""
    plain: dict[str, Any] = json.loads(json.dumps(key))
    return plain


def _point(values: Sequence[float] | Field) -> Point:
    x, y, z = (float(v) for v in values)
    return x, y, z
