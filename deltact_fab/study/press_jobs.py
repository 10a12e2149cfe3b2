"""Presses on the virtual rig inside a pure job: given as data, in a folder removed at the end.

Each is carried out as a run has it, and its record analysed as any other; then the images go.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from .. import catalog, record
from ..experiment.session import run_presses
from ..jobs import tell
from ..patterns.recipe import PatternRecipe
from ..protocols.plan import Protocol
from ..rig.config import VirtualConfig
from ..rig.job import RigSetup as RigJob
from ..shapes import SensorDimensions
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


def gel_of(bench: VirtualRig) -> dict[str, Any]:
    """What the gel reports of presses, plain data.

    why: a line a mesh. cells_mm: of each. coarse: cells over those that the tolerance asks for, the
    worst. flags: by kind, the first in full. between_mm, between_n: the largest error of
    interpolation between its knots, where it was tried. left_out: by the rig.
    """
    presses = bench.presses
    opened = [press for press in presses.opened if press.name]
    between = presses.between
    flags: dict[str, str] = {}
    for press in opened:
        for flag in (flag for knot in press.solver.knots for flag in knot.flags):
            flags.setdefault(flag.partition(":")[0], flag)
    by_name = {path.press: path for path in presses.paths}
    choices = [presses.choice(by_name[press.name]) for press in opened]
    return {
        "why": sorted({choice.why for choice in choices}),
        "cells_mm": sorted({choice.spacing_mm for choice in choices}),
        "coarse": max((c.spacing_mm / c.asked_mm for c in choices if c.asked_mm), default=1.0),
        "flags": flags,
        "between_samples": between.samples,
        "between_mm": between.displacement_mm,
        "between_n": presses.modulus_mpa * between.force_n,
        "left_out": bench.left_out(),
    }
