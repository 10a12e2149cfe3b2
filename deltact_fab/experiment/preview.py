"""What a protocol comes to on a rig, with no device opened: checks, steps, time, forces."""

from __future__ import annotations

from pathlib import Path

from .. import preflight
from ..aliases import Progress
from ..cad.design import load_design
from ..protocols import limits, plan
from ..protocols.pace import LOCKSTEP, SIMULATED, WALL_CLOCK
from ..protocols.plan import Step
from ..rig import config as rig_config
from ..rig.tool import requirements
from .kinds import kind_of
from .request import judged


def checks(
    protocol_name: str,
    rig_name: str,
    air: bool = False,
    unattended: bool = False,
    out: Path = Path(),
    progress: Progress | None = None,
) -> list[limits.LimitCheck]:
    """Static checks of a protocol on a rig: a run begins where all are ok.

    Only a real rig can refuse for its forces, so they are solved for that (minutes, once); for a
    simulated one those that are known already are taken. out: a folder on the disk that the run
    will be written to.
    """
    protocol, source = plan.load(protocol_name)
    rig, path = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    kind = kind_of(rig, path)
    steps = plan.expand(protocol, air)
    rows = judged(
        protocol, source, sensor, steps, rig, path, kind, out,
        air=air, unattended=unattended, wall_clock=not rig.simulated,
    )  # fmt: skip
    if rig.kind == "grbl" and not air:
        unknown = requirements.undeclared_lengths(rig, protocol)
        what, where = "unknown", "; ".join(unknown)
        rows.append(
            limits.LimitCheck("tool lengths", True, what, len(unknown), 0, where, bool(unknown))
        )
    # What leaves the gel or the stage is said already, and has no force.
    if all(row.ok for row in rows) and not air:
        declared = preflight.limits_of(rig, str(path), protocol)
        peaks = preflight.predict(
            protocol, sensor, declared.origin_mm, progress, solve=not rig.simulated
        )
        if peaks is not None:
            rows += preflight.checks(peaks, declared)
            rows += preflight.plate_checks(peaks, sensor, declared.simulated)
    return rows


def show(
    protocol_name: str, rig_name: str, air: bool = False, realtime: bool = False
) -> tuple[list[Step], limits.RunEstimate]:
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
