"""Change of a virtual sensor during a run, by the planned time of each press.

Inside a press the time since its start is added. So a press that is repeated after a resume, or
carried out alone, is the press of the whole run.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import RigSetup, RunEstimate, Step, VirtualConfig, expand_protocol
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
        plan: dict[str, list[tuple[Step, float]]] = {}  # steps and their ends, by press
        steps = expand_protocol(job.protocol, job.air)
        ends_s = RunEstimate.planned_ends_s(steps, config.stage)
        for step, end_s in zip(steps, ends_s[1:], strict=True):
            if step.kind != "change":
                plan.setdefault(step.press, []).append((step, end_s))
        self._begin_s = {press: moves[0][1] for press, moves in plan.items()}
        self._dents = {
            press: self._dent(plan[last], moves[0][0])
            for last, (press, moves) in zip(plan, list(plan.items())[1:], strict=False)
        }

    def _dent(self, last: list[tuple[Step, float]], rest: Step) -> tuple[float, float]:
        """Depth (mm) at the place of a rest that a press leaves at its end, and that time (s)."""
        contact = [(step, end_s) for step, end_s in last if step.kind != "travel"]
        half_mm = max(parse_indenter(last[0][0].indenter).footprint_half_mm)
        away_mm = max(math.dist(rest.target_mm[:2], last[0][0].target_mm[:2]), half_mm)
        depth_mm = max(-step.target_mm[2] for step, _ in contact)
        share = self._config.residual * 2 / math.pi * math.asin(half_mm / away_mm)
        return share * max(depth_mm, 0.0), contact[-1][1]

    def light(self) -> float:
        """Light now, as a share of that at the start of the run."""
        (time_s,) = self._planned_s(np.array([self._scene.clock.now_ns()]))
        return max(1.0 + self._config.light_per_h * float(time_s) / 3600, 0.0)

    def wrenches(self, t_ns: NDArray[np.int64]) -> Field:
        """Wrenches (n, 6) of the scene at times (n,) as the force sensor measures them."""
        true = self._scene.wrenches(t_ns)
        time_s, (press, _) = self._planned_s(t_ns), self._scene.begun
        gain = np.maximum(1.0 + self._config.force_gain_per_h * time_s / 3600, 0.0)
        dent_mm, since_s = self._dents.get(press, (0.0, 0.0))
        if dent_mm:
            left_mm = dent_mm * np.exp((since_s - time_s) / self._config.recovery_s)
            depth_mm = np.array([self._scene.depth_mm(t) for t in t_ns.tolist()])
            gain *= np.clip(1.0 - left_mm / np.maximum(depth_mm, MIN_TIP_DEPTH_MM), 0.0, 1.0)
        return np.asarray(gain[:, None] * true)

    def _planned_s(self, t_ns: NDArray[np.int64]) -> Field:
        """Planned times (n,) since the start of the run."""
        press, begun_ns = self._scene.begun
        return self._begin_s.get(press, 0.0) + (t_ns - begun_ns) / NS_PER_S
