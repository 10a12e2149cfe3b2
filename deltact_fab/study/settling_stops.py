"""Stops of a press: how much too high the force at each still is, solved, recorded or judged.

`follow` is a job, kept under the hash of this module: no words or figures belong into it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..aliases import Field
from ..analysis.relaxation import Series, time_to
from ..protocols.plan import Protocol, expand
from ..rig.simulator import GelConfig
from ..shapes import SkinDimensions
from ..virtual.paths import poses
from ..virtual.presses import Presses

PERCENTS = (5, 2, 1, 0.5)  # of the steady force: bounds whose waits are told
BOUND = 2  # of them, that of the headlines
AXES = {"press": [2], "shear": [0, 1]}  # the forces that a stop was made for
ROUNDING = 1e-9  # of a force: a ball that nothing drags has no shear
WAITS_S = np.geomspace(0.05, 600.0, 33)


def follow(given: dict[str, Any]) -> dict[str, Any]:
    """One press of a protocol knot by knot.

    given: protocol, gel (resolution) and skin as data, press. Result: t_s (n + 1,) since first
    touch, force_n (n + 1, 3), moved_mm: how far a point of the face moves in plane, at most, while
    the tip rests (0 without fields); stops: of each line of motion that ends in contact id, kind,
    depth_mm, rests_s and the knots `arrived` and `left` at the ends of its rest; of the solver
    flags and dofs.
    """
    protocol = Protocol.model_validate(given["protocol"])
    skin = SkinDimensions(**given["skin"])
    presses = Presses(protocol, skin, GelConfig.model_validate(given["gel"]))
    path = next(path for path in presses.paths if path.press == given["press"])
    solver = presses.of(path).solver
    knots = solver.solve_all()
    planned = poses(path, presses.increments, presses.relaxing_s)
    forces = np.array([(0.0, 0.0, 0.0), *(knot.force_n for knot in knots)]) * presses.modulus_mpa
    moved = 0.0
    # The steps that end in contact: those that its path has a line for.
    moves = [s for s in expand(protocol) if s.press == path.press and s.kind != "hold"]
    steps = [s for s in moves if s.target_mm[2] < 0]
    lines = [line for line in path.lines if line.end_mm[2] < 0]
    stops: list[dict[str, Any]] = [
        {"id": step.id, "kind": step.kind, "depth_mm": -step.target_mm[2], "rests_s": line.dwell_s}
        for step, line in zip(steps, lines, strict=True)
    ]
    line = 0
    for n, pose in enumerate(planned, start=1):
        if pose.part == 1.0:
            stops[line] |= {"arrived": n, "left": n}
            line += 1
        elif pose.part == 0.0:
            stops[line - 1]["left"] = n
            start, now = (knots[at - 1].displacement_mm for at in (stops[line - 1]["arrived"], n))
            if start is not None and now is not None:
                off = now.astype(float) - start
                moved = max(moved, float(np.hypot(off[..., 0], off[..., 1]).max()))
    return {
        "t_s": np.concatenate([[0.0], np.cumsum([pose.seconds for pose in planned])]),
        "force_n": forces,
        "moved_mm": moved,
        "stops": stops,
        "flags": solver.flags,
        "dofs": solver.dofs,
    }


@dataclass(frozen=True, eq=False)
class Stop:
    """One stop: how far its force is off the steady one, in the forces that it was made for.

    kind: press or shear. group: what errs together, the press and drags of a depth. steady_n: size
    of the steady force. excess_n (n,) at wait_s (n,) since the tip came to rest, as solved or
    measured; series_n (n,): the same by the closed form, or by the fit. fade_s, fade_n (m,): the
    excess that waits are read from: the solved one, or the series where samples have noise.
    """

    name: str
    kind: str
    depth_mm: float
    group: str
    steady_n: float
    wait_s: Field
    excess_n: Field
    series_n: Field
    fade_s: Field
    fade_n: Field

    def row(self) -> dict[str, Any]:
        """Of the table: waits in seconds until the force stays within each bound; nan: unknown."""
        return {
            "stop": self.name, "kind": self.kind, "depth_mm": self.depth_mm, "group": self.group,
            "steady_n": self.steady_n, "at_once_n": float(self.excess_n[0]),
            "at_once_percent": float(100 * self.excess_n[0] / self.steady_n),
            **{f"wait_{p:g}_percent_s": time_to(self.fade_s, self.fade_n, p * self.steady_n / 100)
               for p in PERCENTS},
        }  # fmt: skip


def size(force_n: Field, kind: str) -> Field:
    """(n,) of forces (n, 3): their size in the forces that a stop of a kind was made for."""
    return np.asarray(np.linalg.norm(force_n[..., AXES[kind]], axis=-1))


def simulated(found: dict[str, Any], elastic: dict[str, Any], series: Series) -> list[Stop]:
    """The stops of a press on the viscous gel, with the closed form on the elastic one beside.

    found, elastic: of `follow`, of one and the same way with rests and without.
    """
    told = series.excess(found["t_s"], slow_force(found, elastic))
    stops = []
    for stop in found["stops"]:
        at, kind = slice(stop["arrived"], stop["left"] + 1), stop["kind"]
        if stop["arrived"] == stop["left"]:
            continue
        force, wait_s = found["force_n"][at], found["t_s"][at] - found["t_s"][at.start]
        excess = size(force - force[-1], kind)
        stops.append(
            Stop(
                stop["id"], kind, stop["depth_mm"], f"{stop['depth_mm']:g} mm",
                float(size(force[-1], kind)), wait_s, excess, size(told[at], kind), wait_s, excess,
            )
        )  # fmt: skip
    return stops


def slow_force(found: dict[str, Any], elastic: dict[str, Any]) -> Field:
    """The elastic gel's force (n, 3) at the knots of a way with rests."""
    moving = np.ones(len(found["t_s"]), bool)
    for stop in found["stops"]:
        moving[stop["arrived"] + 1 : stop["left"] + 1] = False
    return np.asarray(elastic["force_n"][np.cumsum(moving) - 1])


def judged(elastic: dict[str, Any], series: Series, settle_s: float) -> dict[str, float]:
    """What a protocol's stops are off by in the closed form, each after a rest of settle_s.

    elastic: of `follow`, the way as it is driven, whose `rests_s` say which stops are taken.
    common: the factor that all stops share, which a calibration takes into its coefficients;
    scatter_n: what is left of it, rms, which it cannot.
    """
    at = np.array([stop["arrived"] for stop in elastic["stops"] if stop["rests_s"] > 0])
    t, force = elastic["t_s"], elastic["force_n"]
    late = t + settle_s * np.searchsorted(at, np.arange(len(t)))
    times = np.insert(late, at + 1, late[at] + settle_s)
    ends = at + 1 + np.arange(len(at))
    excess = series.excess(times, np.insert(force, at + 1, force[at], axis=0))[ends]
    steady = force[at]
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


def enough_s(elastic: dict[str, Any], series: Series) -> float:
    """settle_s from which on no stop of a protocol is off by more than BOUND; nan: none tried."""
    worst = [judged(elastic, series, float(wait))["worst_percent"] for wait in WAITS_S]
    return time_to(WAITS_S, worst, BOUND)
