"""A run as it was asked for, checked as far as it can be before a device is opened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .. import preflight, record
from ..aliases import Progress
from ..cad.design import load_design
from ..errors import InputError, MissingLibrary
from ..patterns.recipe import load_recipe
from ..protocols import limits, plan
from ..protocols.plan import Protocol, Step
from ..rig import config as rig_config
from ..rig.config import RigConfig
from ..rig.job import RigKind, RigSetup
from ..rig.tool import requirements
from ..shapes import SensorDimensions
from .kinds import kind_of


@dataclass(frozen=True)
class Asked:
    """A run as it was asked for, with everything checked that can be without a device."""

    job: RigSetup
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
        raise InputError(f"--seed: {seed}; expected 0 or more")
    protocol, source = plan.load(protocol_name)
    rig, rig_path = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    steps = plan.expand(protocol, air)
    kind = kind_of(rig, rig_path, realtime, progress)
    rows = judged(
        protocol, source, sensor, steps, rig, rig_path, kind, out if disk is None else disk,
        air=air, unattended=unattended, wall_clock=realtime or not rig.simulated,
    )  # fmt: skip
    limits.require(rows, str(source))
    job = RigSetup(
        protocol, sensor, load_recipe(protocol.specimen.pattern), seed, out, air,
        unattended=unattended, tip_is_clear=tip_is_clear,
    )  # fmt: skip
    return Asked(job, source, rig, rig_path, kind, steps, realtime)


def judged(
    protocol: Protocol,
    source: Path,
    sensor: SensorDimensions,
    steps: list[Step],
    rig: RigConfig,
    rig_path: Path,
    kind: RigKind,
    out: Path,
    *,
    air: bool,
    unattended: bool,
    wall_clock: bool,
) -> list[limits.LimitCheck]:
    """Every check of a run but that of its forces: a run begins when all rows are ok.

    source, rig_path: of the two files. out: a folder on the disk that is judged. wall_clock:
    whether frames that come too fast are lost. Raises InputError for a calibration that is of no
    use.
    """
    rows = limits.check(protocol, sensor, rig.stage.box, steps)
    rows += preflight.needs(protocol, sensor, steps, rig, kind, out, wall_clock)
    rows.append(limits.refusals(kind.part, kind.refusals(protocol, sensor, str(source))))
    rows.append(limits.refusals("pattern", _pattern(protocol, source)))
    rows.append(limits.refusals("image format", _format(rig)))
    if rig.kind == "grbl" and not air:
        unmet = requirements.unmet(rig, protocol, sensor, unattended)
        rows.append(limits.refusals("contact", [f"{rig_path}: {line}" for line in unmet]))
    return rows


def _pattern(protocol: Protocol, source: Path) -> list[str]:
    """Why the specimen's pattern does not serve the protocol."""
    name = protocol.specimen.pattern
    try:
        recipe = load_recipe(name)
    except InputError as why:
        return [f"{source}: specimen.pattern: {why}"]
    if "dots" in protocol.channels and recipe.dots is None:
        return [
            f"{source}: channels: 'dots' asked for, and the pattern {name!r} has none; take one "
            "with dots, as 'dense-with-dots', or remove \"dots\""
        ]
    return []


def _format(rig: RigConfig) -> list[str]:
    """Why images cannot be written as the rig's camera has it."""
    try:
        record.require_format(record.image_format({"rig": rig.recorded()}))
    except MissingLibrary as why:
        return [str(why)]
    return []
