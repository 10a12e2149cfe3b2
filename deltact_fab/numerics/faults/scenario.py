"""What is rehearsed: few steps of two presses of a protocol, on a stage, beneath a guard."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ...errors import InputError
from ...optics import StageFrame
from ...protocols import plan
from ...protocols.plan import Protocol, Step
from ...rig.config import RigConfig
from ...rig.force.guard import GuardLimits
from ...rig.tables import ForceConfig
from ...virtual.grbl_lines import settings_for

DRAGS = 1  # of a press
SETTLE_S = 0.2
PRESSED, PUSHED = 0.1, 1.05  # of the guard's limit: at the deepest, by a fault


@dataclass(frozen=True)
class Scenario:
    """text: of the protocol. settings: of the controller, None for its usual ones."""

    text: bytes
    steps: tuple[Step, ...]
    frame: StageFrame
    settings: Mapping[int, float] | None
    force: ForceConfig
    limits: GuardLimits

    @property
    def second(self) -> str:
        """The press in which faults strike: the last."""
        return self.steps[-1].press

    @property
    def limit_n(self) -> float:
        """Of the guard along z."""
        return min(self.limits.force_n[2], self.limits.resultant_n)

    @property
    def push_n(self) -> float:
        """Over the guard's limit, and within the sensor's range where that lets it be."""
        return PUSHED * self.limit_n

    @property
    def hertz(self) -> float:
        """N / mm^1.5 of a gel that the deepest press does not trip the guard on."""
        deepest_mm = max(-step.target_mm[2] for step in self.steps)
        return PRESSED * self.limit_n / max(deepest_mm, 0.1) ** 1.5


def of_lab(protocol: Protocol, text: bytes, rig: RigConfig) -> Scenario:
    """A lab's protocol, cut short, on the stage of its rig file. Raises InputError for no press."""
    stage = rig.stage
    limits = stage.travel_mm, stage.max_feed_mm_min, stage.acceleration_mm_s2
    settings = {**settings_for(*limits), 27: stage.pull_off_mm}
    force = rig.force or ForceConfig()
    guard = GuardLimits.of(rig.guard, force)
    return Scenario(text, _cut(plan.expand(protocol)), stage.frame, settings, force, guard)


def _cut(steps: Sequence[Step]) -> tuple[Step, ...]:
    """The first press and the deepest other; of each its lowest depth, DRAGS, frames at rest.

    A frame in mid-move has another place each time, by what a host's clock makes of it.
    """
    presses = [list(part) for _, part in itertools.groupby(steps, lambda step: step.press)]
    changes = {part[0].indenter: part[0] for part in presses if part[0].kind == "change"}
    presses = [part for part in presses if part[0].kind != "change"]
    if not presses:
        raise InputError("the protocol presses nothing")
    deepest = min(presses[1:] or presses, key=lambda part: min(s.target_mm[2] for s in part))
    kept: list[Step] = []
    for part in (presses[0], deepest) if len(presses) > 1 else (deepest,):
        if not kept or kept[-1].indenter != part[0].indenter:
            kept.append(changes[part[0].indenter])
        low = [i for i, step in enumerate(part) if step.kind == "press"][-1]
        for i, step in enumerate(part):
            far = step.kind in ("press", "shear") and not low <= i <= low + DRAGS
            if not far:
                settle_s = max(step.settle_s, SETTLE_S) if step.frames else 0.0
                kept.append(replace(step, frames=min(step.frames, 1), settle_s=settle_s))
    return tuple(kept)
