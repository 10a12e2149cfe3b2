"""`study run shapes`: the paper's Shape Reconstruction and its figure of the force distribution.

Sphere, cylinder, ring and toy hat, pressed on the virtual rig or recorded on any bench: the paper's
gallery, the depth's error against truth where there is one, and the force field of a sheared press.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..report.result import LeftOut, StudyResult
from . import gel_remarks
from .request import StudyRequest, share_of

if TYPE_CHECKING:
    from ..analysis.shape import PressShape, ShapeMaps
    from ..measure.sensor_id import Kind
    from ..record import Run

STUDY = "shapes"
TWIST = (
    "A stage of three axes does not turn: the twist is a ball sheared far from the centre, which "
    "gives torque about the face's middle; a turn about the ball's own axis would show as a whirl."
)


def run(asked: StudyRequest) -> StudyResult:
    """The study, simulated or of recorded runs. Raises InputError, RunFailed."""
    return _recorded(asked) if asked.runs else _simulated(asked)


def _simulated(asked: StudyRequest) -> StudyResult:
    from ..analysis.shape import deepest
    from .scene import left_out
    from .shape import summary
    from .shape.simulated import settings, simulate

    if named := next((name for name in ("depth", "force") if asked.more.get(name)), None):
        raise InputError(f"--{named}: only with --from; a simulated sensor is calibrated here")
    made = simulate(asked)
    twist = made.twist
    modulus_mpa = next(iter(made.scene.protocols.values())).specimen.modulus_mpa
    pictures = deepest(seen.deepest for seen in made.objects.values())
    return summary.result(
        made.objects,
        pictures,
        _field([twist.twisted if twist else None, *pictures]),
        f"simulated on {made.scene.rig_name}, seed {asked.seed}",
        made.force_error_n.get("normal"),
        (made.depth_line, TWIST, gel_remarks.remark(STUDY, modulus_mpa)),
        simulated=True,
        seed=asked.seed,
        scale=share_of(asked.scale),
        settings=settings(made),
        left_out=left_out(made.gel),
        more={"twist": twist.rows if twist else []},
    )


def _field(pictures: Iterable[ShapeMaps | None]) -> ShapeMaps | None:
    """The first picture that has a traction to be drawn."""
    return next((p for p in pictures if p is not None and p.tractions), None)


def _seen(of: tuple[str, str, Mapping[Kind, Path]]) -> PressShape:
    """A press of a recorded run; of: folder, press and the calibrations of its sensor by kind."""
    from ..analysis.shape import press_shape
    from .shape.press import models

    folder, press, files = of
    return press_shape(folder, press, *models(files))


def _recorded(asked: StudyRequest) -> StudyResult:
    from .. import record
    from ..analysis.frames import recorded
    from ..analysis.shape import deepest
    from ..jobs import each
    from .shape import summary

    for given, option in ((asked.scale, "--scale"), (asked.rig, "--rig")):
        if given is not None:
            raise InputError(f"{option}: does not go with --from, which takes the recorded presses")
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
    pictures = deepest(one.deepest for one in seen.values())
    # First where the torque that was measured is largest, if something was sheared, then a ball.
    twisted = [one.twisted for one in seen.values() if one.twisted is not None]
    twisted.sort(key=lambda p: -abs(p.torque_z_nmm or 0.0))
    balls = sorted(pictures, key=lambda p: not p.indenter.startswith("sphere:"))
    simulated = any(one.simulated for one in runs)
    kinds = {kind: file for _, _, files in jobs for kind, file in files.items()}
    return summary.result(
        seen,
        pictures,
        _field([*twisted, *balls]),
        ", ".join(one.folder.name for one in runs) + (", simulated" if simulated else ""),
        simulated=simulated,
        seed=int(runs[0].meta["seed"]),
        scale=None,
        settings={
            "runs": ", ".join(str(one.folder) for one in runs),
            "depth": str(kinds.get("depth", "not calibrated: as the inverse finds it")),
            "force": str(kinds.get("force", "not calibrated")),
        },
        left_out=tuple(
            LeftOut(what, why)
            for what, why, there in (
                ("errors of depth and contact", "a bench knows no truth",
                 any(one.contact_by for one in seen.values())),
                ("depth in calibrated mm", "no --depth, see `calibrate-depth`", "depth" in kinds),
                ("force and its distribution", "no --force, see `analyze force`", "force" in kinds),
            )
            if not there
        ),
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
