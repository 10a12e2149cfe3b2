"""Change of a virtual sensor during a run, by the planned time of each press.

Inside a press the time since its start is added. So a press that is repeated after a resume, or
carried out alone, is the press of the whole run.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import RigSetup, VirtualConfig, expand_protocol
from deltact_fab.common import Point2
from deltact_fab.sensor import parse_indenter

from .clock import NS_PER_S, VirtualClock
from .netft import Wrenches

S_PER_H = 3600.0


@dataclass(frozen=True)
class _PressPlan:
    """Planned times of a press, from its tare to the end of its retraction, and its dent.

    half_mm: half width of the tip.
    """

    at_mm: Point2
    begin_s: float
    end_s: float
    depth_mm: float
    half_mm: float


class Drift:
    """Gain of the force sensor, light, and the dent that the previous press left.

    The previous press is that of the protocol's order, whichever presses are carried out. The dent
    is as deep beside the tip as the face around a flat round punch (Boussinesq: 2/pi asin(a/r)),
    and it lowers the force in proportion to what remains of the tip's depth.
    """

    def __init__(
        self, config: VirtualConfig, job: RigSetup, clock: VirtualClock,
        depth_mm: Callable[[int], float],
    ) -> None:  # fmt: skip
        """depth_mm: depth of the tip at a time in ns."""
        assert config.virtual.drift is not None, "a rig without the table does not drift"
        self._config, self._clock, self._depth_mm = config.virtual.drift, clock, depth_mm
        steps = expand_protocol(job.protocol, job.air)
        self._plan: dict[str, _PressPlan] = {}
        begin_s = 0.0
        for step, end_s in zip(steps, config.planned_ends_s(steps)[1:], strict=True):
            x, y, z = step.target_mm
            begin_s = end_s if step.id.endswith("/rest") else begin_s
            if step.kind == "change":
                continue
            earlier = self._plan.get(step.press)
            if earlier is None or step.kind != "travel":
                deepest_mm = max(-z, earlier.depth_mm if earlier else 0.0)
                half_mm = max(parse_indenter(step.indenter).footprint_half_mm)
                at_mm = earlier.at_mm if earlier else (x, y)
                self._plan[step.press] = _PressPlan(at_mm, begin_s, end_s, deepest_mm, half_mm)
        self._press = ""
        self._origin_ns = 0

    def begin(self, press: str) -> None:
        """Start the planned time of a press now."""
        if press != self._press:
            self._press, self._origin_ns = press, self._clock.now_ns()

    def light(self) -> float:
        """Light now, as a share of that at the start of the run."""
        time_s = float(self._planned_s(np.array([self._clock.now_ns()]))[0])
        return max(1.0 + self._config.light_per_h * time_s / S_PER_H, 0.0)

    def felt(self, wrenches: Wrenches) -> Wrenches:
        """Return the wrenches (n, 6) at times (n,) as the force sensor measures them."""

        def drifting(t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
            time_s = self._planned_s(t_ns)
            gain = np.maximum(1.0 + self._config.force_gain_per_h * time_s / S_PER_H, 0.0)
            wrench = wrenches(t_ns)
            return np.asarray((gain * self._remaining(t_ns, time_s))[:, None] * wrench)

        return drifting

    def _planned_s(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Planned times (n,) since the start of the run; 0 before the first press."""
        if self._press not in self._plan:
            return np.zeros(len(t_ns))
        return self._plan[self._press].begin_s + (t_ns - self._origin_ns) / NS_PER_S

    def _remaining(
        self, t_ns: NDArray[np.int64], time_s: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Share (n,) of the force that the dent of the previous press leaves."""
        order = list(self._plan)
        number = order.index(self._press) if self._press in self._plan else 0
        if not self._config.residual or number == 0:
            return np.ones(len(t_ns))
        last, place_mm = self._plan[order[number - 1]], self._plan[self._press].at_mm
        away_mm = max(math.dist(last.at_mm, place_mm), last.half_mm)
        dent_mm = self._config.residual * last.depth_mm
        dent_mm *= 2 / math.pi * math.asin(last.half_mm / away_mm)
        left_mm = dent_mm * np.exp(-np.maximum(time_s - last.end_s, 0.0) / self._config.recovery_s)
        depth_mm = np.array([max(self._depth_mm(t), 1e-9) for t in t_ns.tolist()])
        return np.asarray(np.clip(1.0 - left_mm / depth_mm, 0.0, 1.0))
