"""Stops of a press on an elastic gel, and by the closed form what a series leaves at each.

`follow` is a job, kept under the hash of this module: no words or figures belong into it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..aliases import Field
from ..analysis.relaxation import Series, time_to
from ..protocols.plan import Protocol, expand
from ..rig.simulator import GelConfig
from ..shapes import SkinDimensions
from ..virtual.paths import poses
from ..virtual.presses import Presses

GEL = GelConfig(spacing_mm=0.8, press_increment_mm=0.2, shear_increment_mm=0.5)
"""Half or twice as fine changes waits by less than 1 %."""
PERCENTS = (5, 2, 1, 0.5)  # of the steady force: bounds whose waits are told
BOUND = 2  # of them, that of the headlines
AXES = {"press": [2], "shear": [0, 1]}  # the forces that a stop was made for
ROUNDING = 1e-9  # of a force: a ball that nothing drags has no shear
WAITS_S = np.geomspace(0.05, 600.0, 33)


def follow(given: dict[str, Any]) -> dict[str, Any]:
    """The first press of a protocol, knot by knot.

    given: protocol and skin as data. Result: t_s (n + 1,) since first touch, force_n (n + 1, 3);
    stops: of each that rests id, kind, depth_mm and the knot `arrived`.
    """
    protocol = Protocol.model_validate(given["protocol"])
    presses = Presses(protocol, SkinDimensions(**given["skin"]), GEL)
    path = presses.paths[0]
    knots = presses.of(path).solver.solve_all()
    planned = poses(path, presses.increments)
    arrived = [n for n, pose in enumerate(planned, start=1) if pose.part == 1.0]
    # The moves that end in contact; a filmed way out of it comes last and is no stop.
    own = [s for s in expand(protocol) if s.press == path.press and s.kind != "hold"]
    steps = [step for step in own if step.target_mm[2] < 0]
    return {
        "t_s": np.cumsum([0.0, *(pose.seconds for pose in planned)]),
        "force_n": np.array([(0.0, 0.0, 0.0), *(k.force_n for k in knots)]) * presses.modulus_mpa,
        "stops": [
            {"id": step.id, "kind": step.kind, "depth_mm": -step.target_mm[2], "arrived": n}
            for step, n in zip(steps, arrived, strict=False) if step.settle_s > 0
        ],
    }  # fmt: skip


def left(way: dict[str, Any], series: Series, wait_s: Field) -> tuple[Field, Field]:
    """Of the stops the steady force (s, 3), and what it has too much (s, m, 3).

    way: of `follow`. wait_s (m,): rising, since the tip came to rest; each rest ends with the last.
    """
    t, force, m = way["t_s"], way["force_n"], len(wait_s)
    at = np.array([stop["arrived"] for stop in way["stops"]])
    late = t + wait_s[-1] * np.searchsorted(at, np.arange(len(t)))
    where = np.repeat(at + 1, m)
    times = np.insert(late, where, (late[at, None] + wait_s).ravel())
    held = np.insert(force, where, np.repeat(force[at], m, axis=0), axis=0)
    rests = (at + 1 + m * np.arange(len(at)))[:, None] + np.arange(m)
    return force[at], series.excess(times, held)[rests]


def size(force_n: Field, kind: str) -> Field:
    """(n,) of forces (n, 3): their size in the forces that a stop of a kind was made for."""
    return np.asarray(np.linalg.norm(force_n[..., AXES[kind]], axis=-1))


def judged(way: dict[str, Any], series: Series, settle_s: float) -> dict[str, float]:
    """What a protocol's stops are off by in the closed form, each after a rest of settle_s.

    common: the factor that all stops share, which a calibration takes into its coefficients;
    scatter_n: what is left of it, rms, which it cannot.
    """
    steady, after = left(way, series, np.array([settle_s]))
    excess = after[:, 0]
    off, whole = np.linalg.norm(excess, axis=1), np.linalg.norm(steady, axis=1)
    row = {"settle_s": settle_s, "worst_n": float(off.max()),
           "worst_percent": float(100 * (off / whole).max())}  # fmt: skip
    for name, axes in (("normal", AXES["press"]), ("shear", AXES["shear"])):
        e, s = excess[:, axes], steady[:, axes]
        common = float((e * s).sum() / (s * s).sum()) if (s * s).sum() > 0 else 0.0
        scatter = float(np.sqrt(np.mean(np.sum((e - common * s) ** 2, axis=1))))
        if scatter < ROUNDING * float(whole.max()):
            scatter = 0.0
        row |= {f"{name}_common_percent": 100 * common, f"{name}_scatter_n": scatter}
    return row


def enough_s(way: dict[str, Any], series: Series) -> float:
    """settle_s from which on no stop of a protocol is off by more than BOUND; nan: none tried."""
    worst = [judged(way, series, float(wait))["worst_percent"] for wait in WAITS_S]
    return time_to(WAITS_S, worst, BOUND)
