"""`study run force-calibration`: the paper's Contact Force Distribution, whole.

Five balls at nine places, 46 settled points at each (Linear Regression Analysis): the paper's model
and better ones on the same points, judged on what they never saw; simulated, or recorded on any
bench.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..errors import InputError
from ..report.result import LeftOut, ReportTable, StudyResult
from .request import StudyRequest

if TYPE_CHECKING:
    from ..analysis.force import ForceResult

STUDY = "force-calibration"
_LAYERS = {"lens": "lens", "viscosity": "its viscosity", "solid models": "cadquery"}
"""What a rig calls what it left out: the layer whose cost `numerics` measures."""


def run(asked: StudyRequest) -> StudyResult:
    """The study, simulated or of recorded runs. Raises InputError, RunFailed."""
    return _recorded(asked) if asked.runs else _simulated(asked)


def _simulated(asked: StudyRequest) -> StudyResult:
    from .force.simulated import meshes, settings, simulate
    from .force.summary import modulus, told, with_modulus

    made = simulate(asked)
    of, result = made.scene, made.result
    scale = 1.0 if asked.scale is None else asked.scale
    found = told(result, STUDY, scale)
    table = modulus(
        result, of.protocol.specimen.modulus_mpa, of.rig.force.range_n, of.rig.force.range_nmm
    )
    found = with_modulus(found, of.protocol.specimen.modulus_mpa, table)
    scene = settings(of, made.gel)
    gel = ReportTable(
        "force-gel",
        "The gel. The presses of each job, what the solver flags of their mesh, and the largest "
        "error of linear interpolation between solved poses, where it was tried.",
        meshes(made.gel),
        ("presses", "flags", "between_poses_n", "between_poses_mm"),
    )
    shown = {line for one in made.gel for line in one["left_out"]}
    return replace(
        found,
        tables=(*found.tables, gel),
        settings=scene,
        data={**found.data, "scale": scale, "settings": scene},
        left_out=(*(_scene(line) for line in sorted(shown)), *_left_out(result)),
        missing=tuple(made.missing),
    )


def _recorded(asked: StudyRequest) -> StudyResult:
    from .. import record
    from ..analysis.force import calibrate
    from .force.summary import modulus, told, with_modulus

    given = {"scale": asked.scale, "rig": asked.rig, "protocol": asked.more.get("protocol")}
    for name, value in given.items():
        if value is not None:
            raise InputError(f"--{name}: does not go with --from: the points are those of its runs")
    runs = [record.open(folder) for folder in asked.runs]
    for run in runs:
        level = run.meta["protocol"]["specimen"]["gel_model"]
        if run.simulated and level != "hyperelastic":
            raise InputError(
                f"{run.folder}: simulated with gel_model = {level!r}; a calibration is judged on "
                "'hyperelastic'"
            )
    result = calibrate(asked.runs, None, asked.seed, asked.executor, asked.progress)
    found = told(result, STUDY, None)
    specimen, force = runs[0].meta["protocol"]["specimen"], runs[0].meta["rig"].get("force")
    if runs[0].simulated and force:
        table = modulus(
            result, specimen["modulus_mpa"], tuple(force["range_n"]), tuple(force["range_nmm"])
        )
        found = with_modulus(found, specimen["modulus_mpa"], table)
    scene = {
        "runs": ", ".join(str(folder) for folder in asked.runs),
        "rig": ", ".join(dict.fromkeys(str(run.meta["rig_name"]) for run in runs)),
        "pattern": str(specimen["pattern"]),
    }
    notes = [] if result.field is None else [result.field.line]
    return replace(
        found,
        settings=scene,
        data={**found.data, "settings": scene},
        notes=(*found.notes, *notes),
        left_out=_left_out(result),
    )


def _scene(line: str) -> LeftOut:
    """Of a line of a rig: "what: why"."""
    what, _, why = line.partition(": ")
    return LeftOut(what, why, layer=_LAYERS.get(what.partition(",")[0], ""))


def _left_out(result: ForceResult) -> tuple[LeftOut, ...]:
    """Points that were not taken, and models without points enough."""
    return tuple(LeftOut("points or models", line) for line in result.left_out)
