"""`study run shapes`: the paper's Shape Reconstruction and its figure of the force distribution.

Sphere, cylinder, ring and toy hat, pressed on the virtual rig or recorded on any bench: the paper's
gallery, the depth's error against truth where there is one, force fields of a press and a twist.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..report.result import LeftOut, StudyResult
from . import gel_remarks
from .request import StudyRequest, share_of

if TYPE_CHECKING:
    from ..analysis.shape import PressShape, ShapeMaps
    from ..measure.sensor_id import Kind
    from ..record import Run

STUDY = "shapes"


def run(asked: StudyRequest) -> StudyResult:
    """The study, simulated or of recorded runs. Raises InputError, RunFailed."""
    return _recorded(asked) if asked.runs else _simulated(asked)


def _simulated(asked: StudyRequest) -> StudyResult:
    from .scene import left_out
    from .shape import summary
    from .shape.simulated import settings, simulate

    if named := next((name for name in ("depth", "force") if asked.more.get(name)), None):
        raise InputError(f"--{named}: only with --from; a simulated sensor is calibrated here")
    made = simulate(asked)
    of, scene, scale = made.scene, settings(made), share_of(asked.scale)
    first = [seen.deepest for job, seen in made.objects.items() if job.endswith("/p1")]
    pictures = [picture for picture in first if picture is not None]
    twisted = {} if made.twist is None else {"twist": made.twist.rows}
    modulus_mpa = next(iter(of.protocols.values())).specimen.modulus_mpa
    found = summary.result(
        made.objects,
        pictures,
        _ball(pictures),
        None if made.twist is None else made.twist.twisted,
        f"simulated on {of.rig_name}, seed {asked.seed}",
        made.force_error_n.get("normal"),
    )
    return replace(
        found,
        data={
            **found.data, **twisted, "simulated": True, "seed": asked.seed, "scale": scale,
            "settings": scene, "depth_calibration": made.depth_line,
            "force_rmse_left_out_position_n": made.force_error_n,
        },
        simulated=True,
        seed=asked.seed,
        scale=scale,
        settings=scene,
        notes=(
            made.depth_line, summary.DENSITY, summary.TWIST, gel_remarks.remark(STUDY, modulus_mpa),
        ),
        left_out=left_out(made.gel),
        missing=made.missing,
    )  # fmt: skip


def _ball(pictures: Sequence[ShapeMaps]) -> ShapeMaps | None:
    """Of the pictures the first of a ball."""
    return next((p for p in pictures if p.indenter.startswith("sphere:")), None)


def _seen(of: tuple[str, str, Mapping[Kind, Path]]) -> PressShape:
    """A press of a recorded run; of: folder, press and the calibrations of its sensor by kind."""
    from ..analysis.shape import press_shape
    from .shape.press import models

    folder, press, files = of
    return press_shape(folder, press, *models(files))


def _recorded(asked: StudyRequest) -> StudyResult:
    from .. import record
    from ..analysis.frames import recorded
    from ..jobs import each
    from .shape import summary

    if asked.scale is not None or asked.rig is not None:
        named = "--scale" if asked.scale is not None else "--rig"
        raise InputError(f"{named}: does not go with --from, which takes the recorded presses")
    runs = [record.open(folder) for folder in asked.runs]
    jobs = []
    for open_run in runs:
        files = _calibrations(open_run, asked.more)
        presses = dict.fromkeys(recorded(open_run, "shape")["press"])
        jobs += [(str(open_run.folder), str(press), files) for press in presses]
    names = [f"{Path(folder).name}/{press}" for folder, press, _ in jobs]
    seen = dict(zip(names, each(_seen, jobs, names, asked.executor, asked.progress), strict=True))
    if not any(row["tip_depth_mm"] > 0 for one in seen.values() for row in one.rows):
        raise InputError(f"{runs[0].folder}: nothing is pressed in what was recorded")
    pictures = _deepest([one.deepest for one in seen.values()])
    twisted = [one.twisted for one in seen.values() if one.twisted is not None]
    simulated = any(one.simulated for one in runs)
    kinds = {kind: file for _, _, files in jobs for kind, file in files.items()}
    found = summary.result(
        seen,
        pictures,
        _ball(pictures) or next(iter(pictures), None),
        # Where the torque that was measured is largest, if something was sheared.
        max(twisted, key=lambda p: abs(p.torque_z_nmm or 0.0), default=None),
        ", ".join(one.folder.name for one in runs) + (", simulated" if simulated else ""),
    )
    return replace(
        found,
        data={
            **found.data, "simulated": simulated, "runs": [str(one.folder) for one in runs],
            "calibrations": {kind: str(file) for kind, file in kinds.items()},
        },
        simulated=simulated,
        seed=int(runs[0].meta["seed"]),
        settings={
            "runs": ", ".join(str(one.folder) for one in runs),
            "depth": str(kinds.get("depth", "not calibrated: as the inverse finds it")),
            "force": str(kinds.get("force", "not calibrated")),
        },
        left_out=tuple(_without(kinds, found.data["frames"])),
    )  # fmt: skip


def _calibrations(run: Run, more: Mapping[str, str | None]) -> Mapping[Kind, Path]:
    """By kind: those named, else those that lie in the run's folder. Raises InputError."""
    from ..analysis.measured import calibrations_of
    from ..measure.sensor_id import read_calibration

    kinds: tuple[Kind, ...] = ("depth", "force")
    named = {kind: Path(name) for kind in kinds if (name := more.get(kind))}
    for kind, file in named.items():
        read_calibration(file, kind)
    calibrations_of(run, list(named.values()))
    return {read_calibration(file)[0].kind: file for file in calibrations_of(run)} | named


def _deepest(pictures: Sequence[ShapeMaps | None]) -> list[ShapeMaps]:
    """The deepest of each indenter, in the order of the runs."""
    found: dict[str, ShapeMaps] = {}
    for picture in pictures:
        if picture is None or picture.tip_depth_mm == 0:
            continue
        held = found.get(picture.indenter)
        if held is None or picture.tip_depth_mm > held.tip_depth_mm + 0.01:
            found[picture.indenter] = picture
    return list(found.values())


def _without(kinds: Mapping[Kind, Path], frames: Sequence[dict[str, Any]]) -> list[LeftOut]:
    lines = []
    if not any("depth_error_contact_mm" in frame for frame in frames):
        lines.append(LeftOut("errors of depth and contact", "a bench knows no truth"))
    if "depth" not in kinds:
        lines.append(LeftOut("depth in calibrated mm", "no --depth, see `calibrate-depth`"))
    if "force" not in kinds:
        lines.append(LeftOut("force and its distribution", "no --force, see `analyze force`"))
    return lines
