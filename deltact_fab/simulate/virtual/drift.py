"""Change of a virtual sensor during a run, by the planned time of each press.

Inside a press the time since its start is added. So a press that is repeated after a resume, or
carried out alone, is the press of the whole run.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import RigSetup, Step, VirtualConfig, expand_protocol
from deltact_fab.common import Field
from deltact_fab.sensor import parse_indenter

from .clock import NS_PER_S
from .scene import GelScene

MIN_TIP_DEPTH_MM = 1e-9  # by hand: depth of a tip that touches nothing, and has no force


class Drift:
    """Gain of the force sensor, light, and the dent that the previous press of the plan left.

    The dent is as deep beside the tip as the face around a flat round punch (Boussinesq: 2/pi
    asin(a/r)). It lowers the force in proportion to what remains of the tip's depth.
    """

    def __init__(self, config: VirtualConfig, job: RigSetup, scene: GelScene) -> None:
        assert config.virtual.drift is not None, "a rig without the table does not drift"
        self._config, self._scene = config.virtual.drift, scene
        self._plan: dict[str, list[tuple[Step, float]]] = {}  # steps and their ends, by press
        steps = expand_protocol(job.protocol, job.air)
        for step, end_s in zip(steps, config.planned_ends_s(steps)[1:], strict=True):
            if step.kind != "change":
                self._plan.setdefault(step.press, []).append((step, end_s))
        self._origin_ns, self._begin_s = 0, 0.0
        self._dent_mm, self._dent_s = 0.0, 0.0  # at the end of the previous press, and that end

    def begin(self, press: str) -> None:
        """Start a press now: at the end of its first step, as planned."""
        rest, self._begin_s = self._plan[press][0]
        self._origin_ns = self._scene.clock.now_ns()
        order = list(self._plan)
        number = order.index(press)
        self._dent_mm = 0.0
        if number == 0:
            return
        last = [(step, end_s) for step, end_s in self._plan[order[number - 1]]
                if step.kind != "travel"]  # fmt: skip
        step, self._dent_s = last[-1]
        half_mm = max(parse_indenter(step.indenter).footprint_half_mm)
        away_mm = max(math.dist(rest.target_mm[:2], last[0][0].target_mm[:2]), half_mm)
        depth_mm = max(-step.target_mm[2] for step, _ in last)
        share = 2 / math.pi * math.asin(half_mm / away_mm)
        self._dent_mm = self._config.residual * depth_mm * share

    def light(self) -> float:
        """Light now, as a share of that at the start of the run."""
        time_s = self._planned_s(self._scene.clock.now_ns())
        return max(1.0 + self._config.light_per_h * time_s / 3600, 0.0)

    def apply(self, t_ns: NDArray[np.int64], wrenches: Field) -> Field:
        """Return the true wrenches (n, 6) at times (n,) as the force sensor measures them."""
        time_s = np.array([self._planned_s(t) for t in t_ns.tolist()])
        gain = np.maximum(1.0 + self._config.force_gain_per_h * time_s / 3600, 0.0)
        if self._dent_mm:
            left_mm = self._dent_mm * np.exp((self._dent_s - time_s) / self._config.recovery_s)
            depth_mm = np.array([self._scene.depth_mm(t) for t in t_ns.tolist()])
            gain *= np.clip(1.0 - left_mm / np.maximum(depth_mm, MIN_TIP_DEPTH_MM), 0.0, 1.0)
        return np.asarray(gain[:, None] * wrenches)

    def _planned_s(self, t_ns: int) -> float:
        """Planned time since the start of the run."""
        return self._begin_s + (t_ns - self._origin_ns) / NS_PER_S
