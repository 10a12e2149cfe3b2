"""Stops, simulated or recorded: how much too high the force at each still is, for how long."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..aliases import Field
from ..analysis.relaxation import Series, time_to

SHARES = (0.05, 0.02, 0.01, 0.005)
FORCES_N = (0.05, 0.02)
ROUNDING = 1e-9  # of a force: a ball that nothing drags has no shear
WAITS_S = np.geomspace(0.05, 600.0, 33)


@dataclass(frozen=True, eq=False)
class Stop:
    """One stop. wait_s (n,): since the tip came to rest; force_n (n, 3); steady_n (3,): at the end.

    kind: press or shear. by_series_n (n, 3): what the closed form, or the fit, says of the excess.
    group: what errs together, here the depth's press and drags. fade_s (m,), fade_n (m, 3): the
    excess that waits are read from: the solved one, or the series where samples have noise.
    """

    name: str
    kind: str
    depth_mm: float
    wait_s: Field
    force_n: Field
    steady_n: Field
    by_series_n: Field
    group: str
    fade_s: Field
    fade_n: Field

    @property
    def axes(self) -> list[int]:
        """Which forces the stop was made for: the normal one of a press, in plane of a drag."""
        return [2] if self.kind == "press" else [0, 1]

    @property
    def steady(self) -> float:
        """N: size of the steady force in those."""
        return float(np.linalg.norm(self.steady_n[self.axes]))

    def excess_n(self) -> Field:
        """(n,) N: how far the force is off the steady one, as a vector in those."""
        return np.asarray(np.linalg.norm((self.force_n - self.steady_n)[:, self.axes], axis=1))

    def excess_by_series_n(self) -> Field:
        """(n,) N: the same by the closed form."""
        return np.asarray(np.linalg.norm(self.by_series_n[:, self.axes], axis=1))


def simulated(found: dict[str, Any], elastic: dict[str, Any], series: Series) -> list[Stop]:
    """The stops of a press on the viscous gel, with the closed form on the elastic one beside.

    found, elastic: of `settling_gel.follow`, of one and the same way with rests and without.
    """
    slow = slow_force(found, elastic)
    told = series.excess(found["t_s"], slow)
    stops = []
    for stop in found["stops"]:
        a, b = stop["arrived"], stop["left"]
        if a == b:
            continue
        force, t_s = found["force_n"][a : b + 1], found["t_s"][a : b + 1]
        stops.append(
            Stop(
                stop["id"], stop["kind"], stop["depth_mm"], t_s - t_s[0],
                force, force[-1], told[a : b + 1], f"{stop['depth_mm']:g} mm",
                t_s - t_s[0], force - force[-1],
            )
        )  # fmt: skip
    return stops


def slow_force(found: dict[str, Any], elastic: dict[str, Any]) -> Field:
    """The elastic gel's force (n, 3) at the knots of a way with rests."""
    moving = np.ones(len(found["t_s"]), bool)
    for stop in found["stops"]:
        moving[stop["arrived"] + 1 : stop["left"] + 1] = False
    return np.asarray(elastic["force_n"][np.cumsum(moving) - 1])


def waits(stop: Stop) -> dict[str, float]:
    """Seconds until the force stays within each bound; nan: never in the time that is known."""
    wait, excess = stop.fade_s, np.linalg.norm(stop.fade_n[:, stop.axes], axis=1)
    found = {f"wait_{100 * share:g}pct_s": time_to(wait, excess / stop.steady, share)
             for share in SHARES}  # fmt: skip
    return found | {f"wait_{bound:g}n_s": time_to(wait, excess, bound) for bound in FORCES_N}


def judged(
    elastic: dict[str, Any], series: Series, settle_s: Sequence[float]
) -> list[dict[str, float]]:
    """What a protocol's stops are off by in the closed form, for each time that they may rest.

    elastic: of `settling_gel.follow`, the way as it is driven, whose `rests_s` say which stops are
    taken. bias: the factor that all stops have in common, which a calibration takes into its
    coefficients; scatter_n: what is left of it, rms, which it cannot.
    """
    taken = [stop for stop in elastic["stops"] if stop["rests_s"] > 0]
    at = np.array([stop["arrived"] for stop in taken])
    force = elastic["force_n"]
    found = []
    for rest in settle_s:
        t, slow, ends = _with_rests(elastic, at, rest)
        excess = series.excess(t, slow)[ends]
        steady = force[at]
        off, size = np.linalg.norm(excess, axis=1), np.linalg.norm(steady, axis=1)
        row = {"settle_s": float(rest), "worst_n": float(off.max()),
               "worst_pct": float(100 * (off / size).max())}  # fmt: skip
        for name, axes in (("normal", [2]), ("shear", [0, 1])):
            e, s = excess[:, axes], steady[:, axes]
            bias = float((e * s).sum() / (s * s).sum()) if (s * s).sum() > 0 else 0.0
            scatter = float(np.sqrt(np.mean(np.sum((e - bias * s) ** 2, axis=1))))
            if scatter < ROUNDING * float(size.max()):
                scatter = 0.0
            row |= {f"{name}_bias_pct": 100 * bias, f"{name}_scatter_n": scatter}
        found.append(row)
    return found


def _with_rests(elastic: dict[str, Any], at: NDArray[Any], rest_s: float) -> tuple[Any, Any, Any]:
    """Times and forces of a way whose stops `at` rest for rest_s, and where the rests end in it."""
    t, force = elastic["t_s"], elastic["force_n"]
    times, forces, ends, late = [], [], [], 0.0
    stops = set(at.tolist())
    for n in range(len(t)):
        times.append(t[n] + late)
        forces.append(force[n])
        if n in stops:
            late += rest_s
            times.append(t[n] + late)
            forces.append(force[n])
            ends.append(len(times) - 1)
    return np.array(times), np.array(forces), np.array(ends)
