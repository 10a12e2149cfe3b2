"""Presses on the virtual rig inside a pure job: given as data, in a folder removed at the end.

Each is carried out as a run has it, and its record analysed as any other; then the images go.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from .. import catalog, record
from ..errors import DeltactFabError
from ..experiment.session import run_presses
from ..jobs import tell
from ..patterns.recipe import PatternRecipe
from ..protocols.plan import Protocol
from ..report.result import GEL_FLAGS
from ..rig.config import VirtualConfig
from ..rig.interface import RigSetup as RigJob
from ..shapes import SensorDimensions
from ..virtual.presses import Presses, path_of, stored_files
from ..virtual.rig import VirtualKind
from .grid import GridJob

if TYPE_CHECKING:
    from ..record import Run
    from ..virtual.rig import VirtualRig
    from .request import StudyRequest


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


def gel_jobs(presses: Presses, told: Callable[..., dict[str, Any]], knot_s: float) -> list[GridJob]:
    """A job for each press whose gel is not in the store; one serves its mirror images.

    They come before the jobs that need them: whoever solves a gel leaves it in the store, that of
    the caller too, from where a job that names `gel_files` has it. told: `given` of a press,
    which it takes by the name `press`. knot_s: seconds of one knot. A press that no mesh serves has
    none: its own job says so.
    """
    jobs: dict[str, GridJob] = {}
    for path in presses.paths:
        try:
            press = presses.of(path)
        except DeltactFabError:
            continue
        solver = press.solver
        if solver.found is None and solver.stored_as is not None:
            name, given_ = f"gel {path.press}", told(press=path.press)
            job = GridJob(
                name, solve_gel, given_, knot_s * len(solver.poses), makes=stored_files(press)
            )
            jobs.setdefault(solver.stored_as, job)
    return list(jobs.values())


def solve_gels(asked: StudyRequest, jobs: Sequence[GridJob]) -> None:
    """Jobs of `gel_jobs`, before those of the presses."""
    if jobs:
        asked.say(f"the gel of {len(jobs)} presses is solved first, and kept")
        asked.solve(jobs)


def gel_files(presses: Presses, names: Sequence[str]) -> tuple[str, ...]:
    """Files of the store that have the gels of presses: the `needs` of a job of theirs."""
    found: list[str] = []
    for name in names:
        with suppress(DeltactFabError):  # no mesh serves it
            found += stored_files(presses.of(path_of(presses, name)))
    return tuple(dict.fromkeys(found))


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
def carried_out(told: dict[str, Any]) -> Iterator[tuple[Run, VirtualRig]]:
    """The finished run of presses, until the end of the block, and its rig, closed.

    told: as `given`, with recipe, presses and seed. Raises RunFailed.
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
        bench = run_presses(job, rig, source, told["presses"], share)
        yield record.open(job.folder), bench


def flagged(gel: Sequence[Mapping[str, Any]], of: str) -> dict[str, str]:
    """The setting GEL_FLAGS of a study; none where no gel was flagged. gel: `gel_of` of each."""
    flags = Counter(name for one in gel for name in one["flags"])
    told = "; ".join(f"{name} at {n} of {len(gel)} {of}" for name, n in flags.items())
    return {GEL_FLAGS: told} if told else {}


def gel_of(bench: VirtualRig) -> dict[str, Any]:
    """What the gel reports of presses, plain data.

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
