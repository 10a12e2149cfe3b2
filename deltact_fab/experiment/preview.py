"""What a protocol comes to on a rig, with no device opened: checks, steps, time, forces."""

from __future__ import annotations

from pathlib import Path

from .. import preflight
from ..cad.design import load_design
from ..protocols import limits, plan
from ..protocols.pace import LOCKSTEP, SIMULATED, WALL_CLOCK
from ..protocols.plan import Protocol, Step
from ..rig import config as rig_config
from ..rig.config import RigConfig
from ..rig.tool import demands
from ..shapes import SensorDimensions
from .kinds import Progress, kind_of


def checks(
    protocol_name: str,
    rig_name: str,
    air: bool = False,
    unattended: bool = False,
    out: Path = Path(),
) -> list[limits.Check]:
    """Static checks of a protocol on a rig; of forces those that take seconds to predict.

    out: a folder on the disk that the run will be written to.
    """
    protocol, source = plan.load(protocol_name)
    rig, path = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    kind = kind_of(rig, path)
    steps = plan.expand(protocol, air)
    rows = limits.check(protocol, sensor, rig.stage.box, steps)
    rows += preflight.needs(protocol, sensor, steps, rig, kind, out, not rig.simulated)
    refused = kind.refusals(protocol, sensor, str(source))
    rows += [_check(kind.part, "refusals", refused)]
    rows += _contact(rig, protocol, sensor, air, unattended)
    # What leaves the gel or the stage is said already, and has no force.
    if all(row.ok for row in rows) and not air:
        declared = preflight.limits_of(rig, str(path), protocol)
        peaks = preflight.predict(protocol, sensor, declared.origin_mm, solve=False)
        if peaks is not None:
            rows += preflight.checks(peaks, declared)
            rows += preflight.plate_checks(peaks, sensor, declared.simulated)
    return rows


def show(
    protocol_name: str, rig_name: str, air: bool = False, realtime: bool = False
) -> tuple[list[Step], limits.Estimate]:
    """Steps and estimate of a protocol on a rig; realtime: a virtual one on the wall clock."""
    protocol, _ = plan.load(protocol_name)
    rig, path = rig_config.load(rig_name)
    image_px = preflight.image_px(
        protocol, load_design(protocol.specimen.design), rig, kind_of(rig, path)
    )
    steps = plan.expand(protocol, air)
    pace = (SIMULATED if realtime else LOCKSTEP) if rig.simulated else WALL_CLOCK
    return steps, limits.estimate(protocol, image_px, rig.stage.box, steps, pace)


def forces(
    protocol_name: str, rig_name: str, progress: Progress | None = None, solve: bool = True
) -> tuple[list[preflight.Peak], list[str]] | None:
    """Predicted peaks of a protocol, and what the rig says to them, one line each.

    None where that would take more than seconds and solve is False. Raises InputError.
    """
    protocol, _ = plan.load(protocol_name)
    rig, path = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    limits = preflight.limits_of(rig, str(path), protocol)
    peaks = preflight.predict(protocol, sensor, limits.origin_mm, progress, solve)
    if peaks is None:
        return None
    lines = preflight.judge(protocol.name, sensor.skin.thickness_mm, peaks, limits)
    breaks, remarks = preflight.judge_plate(protocol.name, peaks, sensor)
    return peaks, lines + breaks + remarks


def _check(name: str, what: str, reasons: list[str]) -> limits.Check:
    return limits.Check(name, not reasons, what, len(reasons), 0, "; ".join(reasons))


def _contact(
    rig: RigConfig, protocol: Protocol, sensor: SensorDimensions, air: bool, unattended: bool
) -> list[limits.Check]:
    """What a real rig lacks for a press, and lengths of tools that it does not know."""
    if rig.kind != "grbl" or air:
        return []
    unknown = demands.undeclared_lengths(rig, protocol)
    return [
        _check("contact", "refusals", demands.unmet(rig, protocol, sensor, unattended)),
        limits.Check(
            "tool lengths", True, "unknown", len(unknown), 0, "; ".join(unknown), bool(unknown)
        ),
    ]
