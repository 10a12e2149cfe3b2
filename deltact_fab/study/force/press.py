"""The job of the force study: an indenter at a place and its mirror images, as points of a fit.

The gel is solved once for all of them, or found. Each press is carried out on the virtual rig as a
run has it, and its record analysed as any other; then the images go, and the points stay.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from ... import catalog, record
from ...analysis.force.dataset import PressPoints, points_of
from ...experiment.presses import run_presses
from ...jobs import tell
from ...patterns.recipe import PatternRecipe
from ...protocols.plan import Protocol
from ...rig.config import VirtualConfig
from ...rig.interface import Job as RigJob
from ...shapes import SensorDimensions
from ...virtual.rig import VirtualKind

if TYPE_CHECKING:
    from ...virtual.rig import VirtualRig

_ROW = ("frame_id", "indenter", "run", "press", "position", "x_mm", "y_mm", "cover")


def given(
    protocol: Protocol,
    sensor: SensorDimensions,
    recipe: PatternRecipe,
    rig: VirtualConfig,
    source: Path,
    presses: Sequence[str],
    seed: int,
    features: Sequence[str],
) -> dict[str, Any]:
    """What `points` is told, plain data. source: of the rig file.

    Where that names the file of a camera, it is read again by the job, from the same place.
    """
    plain = protocol.model_dump(mode="json")
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
        "protocol": plain | {"channels": sorted(plain["channels"])},
        # Of a design no more than a sensor is: what is built around it changes no point.
        "sensor": {f.name: asdict(getattr(sensor, f.name)) for f in fields(SensorDimensions)},
        "recipe": recipe.model_dump(mode="json"),
        "rig": rig.model_dump(mode="json"),
        "beside": beside,
        "presses": list(presses),
        "seed": seed,
        "features": list(features),
    }


def points(told: dict[str, Any]) -> dict[str, Any]:
    """The points of presses: rows (lists by column), wrench (n, 6), features/NAME (n, k).

    And what the gel has to say: why (a line a mesh), flags, between_mm and between_n (the largest
    error of interpolation between its knots), left_out and notes of the rig. Raises RunFailed.
    """
    import cv2

    protocol = catalog.validate(Protocol, told["protocol"], "protocol")
    source = Path(told["beside"]["rig"]) if told["beside"] else Path("rig.toml")
    with TemporaryDirectory(prefix="deltact-fab-") as scratch:
        job = RigJob(
            protocol,
            catalog.validate(SensorDimensions, told["sensor"], "sensor"),
            catalog.validate(PatternRecipe, told["recipe"], "recipe"),
            told["seed"],
            Path(scratch) / "run",
        )
        rig = catalog.validate(VirtualConfig, told["rig"], "rig")
        cv2.setNumThreads(1)  # a processor has a job of its own
        bench = run_presses(job, rig, source, told["presses"], _tell)
        run = record.open(job.folder)
        parts = [points_of(run, protocol.name, p, told["features"]) for p in told["presses"]]
    return {**_packed(parts), **_gel(bench)}


def unpacked(value: dict[str, Any]) -> PressPoints:
    """The points of a job's value."""
    import pandas as pd

    features = {
        key.partition("/")[2]: array for key, array in value.items() if key.startswith("features/")
    }
    return PressPoints(pd.DataFrame(value["rows"]), value["wrench"], features, value["refused"])


def _tell(done: int, of: int, what: str) -> None:
    tell(done / max(of, 1))


def _packed(parts: Sequence[PressPoints]) -> dict[str, Any]:
    import pandas as pd

    rows = pd.concat([part.rows for part in parts], ignore_index=True)
    return {
        "rows": {name: rows[name].tolist() for name in _ROW},
        "wrench": np.concatenate([part.wrench for part in parts]),
        "refused": [why for part in parts for why in part.refused],
        **{
            f"features/{name}": np.concatenate([part.features[name] for part in parts])
            for name in parts[0].features
        },
    }


def _gel(bench: VirtualRig) -> dict[str, Any]:
    presses = bench.presses
    opened = [press for press in presses.opened if press.name]
    between = presses.between
    flags: dict[str, str] = {}
    for press in opened:
        for flag in (flag for knot in press.solver.knots for flag in knot.flags):
            flags.setdefault(flag.partition(":")[0], flag)
    by_name = {path.press: path for path in presses.paths}
    return {
        "why": sorted({presses.choice(by_name[press.name]).why for press in opened}),
        "flags": flags,
        "between_samples": between.samples,
        "between_mm": between.displacement_mm,
        "between_n": presses.modulus_mpa * between.force_n,
        "left_out": bench.left_out(),
    }
