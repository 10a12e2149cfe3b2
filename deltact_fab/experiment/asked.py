"""A run as it was asked for, checked as far as it can be before a device is opened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .. import preflight
from ..cad.design import load_design
from ..errors import InputError
from ..patterns.recipe import load_recipe
from ..protocols import limits, plan
from ..protocols.plan import Step
from ..rig import config as rig_config
from ..rig.config import RigConfig
from ..rig.interface import Job, RigKind
from ..rig.tool import demands
from .kinds import Progress, kind_of


@dataclass(frozen=True)
class Asked:
    """A run as it was asked for, with everything checked that can be without a device."""

    job: Job
    source: Path
    rig: RigConfig
    rig_path: Path
    kind: RigKind
    steps: list[Step]
    realtime: bool

    def warnings(self, progress: Progress | None) -> list[str]:
        """Predicted forces beyond the rig's limits or the plate's, or that may trip the guard.

        A line each. Raises InputError on a real rig for what would break something.
        """
        if self.job.air:
            return []
        protocol, sensor = self.job.protocol, self.job.sensor
        design = load_design(protocol.specimen.design)
        limits = preflight.limits_of(self.rig, str(self.rig_path), protocol, self.realtime)
        peaks = preflight.predict(protocol, sensor, limits.origin_mm, progress)
        assert peaks is not None
        lines = preflight.judge(protocol.name, sensor.skin.thickness_mm, peaks, limits)
        breaks, remarks = preflight.judge_plate(protocol.name, peaks, design)
        found = preflight.require(lines + breaks, limits)
        found += preflight.may_trip(protocol.name, peaks, limits) + remarks
        return [f"WARNING: {line}" for line in found]


def asked_for(
    protocol_name: str,
    rig_name: str,
    out: Path,
    seed: int,
    progress: Progress | None,
    air: bool,
    realtime: bool,
    unattended: bool,
    tip_is_clear: bool,
    disk: Path | None = None,
) -> Asked:
    """Load and check it all. Raises InputError.

    disk: a folder on the disk that is judged, in place of out.
    """
    if seed < 0:
        raise InputError(f"--seed: {seed}; 0 or more is right")
    protocol, source = plan.load(protocol_name)
    rig, rig_path = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    if rig.kind == "grbl" and not air:
        refused = demands.unmet(rig, protocol, sensor, unattended)
        _require_none([f"{rig_path}: {line}" for line in refused])
    steps = plan.expand(protocol, air)
    kind = kind_of(rig, rig_path, realtime, progress)
    rows = limits.check(protocol, sensor, rig.stage.box, steps)
    rows += preflight.needs(
        protocol, sensor, steps, rig, kind, out if disk is None else disk,
        realtime or not rig.simulated,
    )  # fmt: skip
    limits.require(rows, str(source))
    _require_none(kind.refusals(protocol, sensor, str(source)))
    job = Job(
        protocol, sensor, load_recipe(protocol.specimen.pattern), seed, out, air,
        unattended=unattended, tip_is_clear=tip_is_clear,
    )  # fmt: skip
    return Asked(job, source, rig, rig_path, kind, steps, realtime)


def _require_none(reasons: list[str]) -> None:
    if reasons:
        more = f"; and {len(reasons) - 1} more" if len(reasons) > 1 else ""
        raise InputError(reasons[0] + more)
