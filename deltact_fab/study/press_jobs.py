"""Presses on the virtual rig inside a pure job: given as data, in a folder removed at the end.

Each is carried out as a run has it, and its record analysed as any other; then the images go, and
what was found in them stays. Calibrations come as the text of their files, so that a job depends on
nothing of its caller.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from .. import catalog, record
from ..analysis.force.dataset import points_of
from ..analysis.runs import view_of
from ..analysis.shape import calibrate_depth, press_shape
from ..errors import DeltactFabError
from ..experiment.session import run_presses
from ..jobs import tell
from ..measure.force.calibration import load_force
from ..measure.shape import DepthModel
from ..patterns.recipe import PatternRecipe
from ..protocols.plan import Protocol
from ..rig.config import VirtualConfig
from ..rig.interface import RigSetup as RigJob
from ..shapes import SensorDimensions
from ..virtual.presses import Presses, path_of
from ..virtual.rig import VirtualKind

if TYPE_CHECKING:
    from ..record import Run
    from ..virtual.rig import VirtualRig


def given(
    protocol: Protocol, sensor: SensorDimensions, rig: VirtualConfig, source: Path, **more: Any
) -> dict[str, Any]:
    """Arguments of a job as plain data, which `read` reads; more: of that job alone.

    source: of the rig file. Where that names the file of a camera, it is read again by the job,
    from the same place.
    """
    beside = None
    if rig.camera is not None:
        kind = VirtualKind(rig, source)
        view, flat = kind.camera(protocol, sensor), kind.flat(protocol)
        beside = {
            "rig": str(source.resolve()),
            "camera": None if view is None else view.as_dict(),
            "flat": None if flat is None else hashlib.sha256(flat.png()).hexdigest(),
        }
    return {
        "protocol": protocol.model_dump(mode="json"),
        # Of a design no more than a sensor is: what is built around it changes no point.
        "sensor": {f.name: asdict(getattr(sensor, f.name)) for f in fields(SensorDimensions)},
        "rig": rig.model_dump(mode="json"),
        "beside": beside,
        **more,
    }


def read(told: dict[str, Any]) -> tuple[Protocol, SensorDimensions, VirtualConfig, Path]:
    """What was `given`."""
    return (
        catalog.validate(Protocol, told["protocol"], "protocol"),
        catalog.validate(SensorDimensions, told["sensor"], "sensor"),
        catalog.validate(VirtualConfig, told["rig"], "rig"),
        Path(told["beside"]["rig"]) if told["beside"] else Path("rig.toml"),
    )


def solve_gel(told: dict[str, Any]) -> dict[str, Any]:
    """The gel of a press into the store; told: as `given`, with `press`.

    One that cannot be solved to its end is kept with the reason, which its press raises at once.
    """
    protocol, sensor, rig, _ = read(told)
    presses = Presses(protocol, sensor.skin, rig.virtual.gel)
    solver = presses.of(path_of(presses, told["press"])).solver
    with suppress(DeltactFabError):
        solver.solve_all(lambda done, of, seconds: tell(done / of))
    return {"knots": len(solver.knots), "flags": solver.flags}


@contextmanager
def carried_out(told: dict[str, Any]) -> Iterator[tuple[Run, dict[str, Any]]]:
    """The finished run of a press, until the end of the block, and what the gel reports of it.

    told: as `given`, with recipe, press and seed. Raises RunFailed.
    """
    import cv2

    def share(done: int, of: int, what: str) -> None:
        tell(done / max(of, 1))

    protocol, sensor, rig, source = read(told)
    with TemporaryDirectory(prefix="deltact-fab-") as scratch:
        recipe = catalog.validate(PatternRecipe, told["recipe"], "recipe")
        view = VirtualKind(rig, source).camera(protocol, sensor)
        job = RigJob(protocol, sensor, recipe, view, told["seed"], Path(scratch) / protocol.name)
        cv2.setNumThreads(1)  # a processor has a job of its own
        bench = run_presses(job, rig, source, [told["press"]], share)
        yield record.open(job.folder), _gel_of(bench)


def _gel_of(bench: VirtualRig) -> dict[str, Any]:
    """What the gel reports of a press, plain data.

    cells_mm: of each mesh. coarse: cells over those that the tolerance requires, the worst. flags:
    by kind, the first in full. left_out: by the rig.
    """
    presses = bench.presses
    opened = [press for press in presses.opened if press.name]
    flags: dict[str, str] = {}
    for press in opened:
        for flag in (flag for knot in press.solver.knots for flag in knot.flags):
            flags.setdefault(flag.partition(":")[0], flag)
    by_name = {path.press: path for path in presses.paths}
    choices = [presses.choice(by_name[press.name]) for press in opened]
    return {
        "cells_mm": sorted({choice.spacing_mm for choice in choices}),
        "coarse": max((c.spacing_mm / c.asked_mm for c in choices if c.asked_mm), default=1.0),
        "flags": flags,
        "left_out": bench.left_out(),
    }


def points(told: dict[str, Any]) -> dict[str, Any]:
    """The `PressPoints` of a press, for a fit of forces, as "points", and what its gel reports.

    told: as of `carried_out`, and names of `features`. Raises RunFailed.
    """
    with carried_out(told) as (run, gel):
        name = str(told["protocol"]["name"])
        found = points_of(run, name, told["press"], told["features"], view_of(run))
    return {"points": found, **gel}


def ball(told: dict[str, Any]) -> dict[str, Any]:
    """A calibration of depth by the press of a ball; told: as of `carried_out`."""
    with carried_out(told) as (run, gel):
        found = calibrate_depth(run.folder)
        return {"toml": found.toml(), "line": found.line, **gel}


def look(told: dict[str, Any]) -> dict[str, Any]:
    """The `PressShape` of a press as "seen", and what its gel reports.

    told: as of `carried_out`, and `depth`, `force`: texts of calibrations.
    """
    with carried_out(told) as (run, gel), TemporaryDirectory() as folder:
        depth, force = (Path(folder) / f"{kind}.toml" for kind in ("depth", "force"))
        for file in (depth, force):
            file.write_text(told[file.stem], encoding="utf-8")
        model = DepthModel.load(depth)[1]
        seen = press_shape(run.folder, told["press"], model, load_force(force))
        return {"seen": seen, **gel}
