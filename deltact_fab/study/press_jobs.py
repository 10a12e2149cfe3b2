"""Presses inside a pure job: given as data, in a folder removed at the end, or as a stream.

Each is carried out on the virtual rig as a run has it, and its record analysed as any other; then
the images go, and what was found in them stays. Calibrations come as the text of their files, so
that a job depends on nothing of its caller. The pattern selection's are followed under several
patterns, simulated or recorded.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import catalog, record
from ..analysis.force.dataset import points_of
from ..analysis.runs import view_of
from ..analysis.shape import calibrate_depth, press_shape
from ..analysis.tracking_error.follow import Follower, TrackingPlan, analyse_press, tracking_plan_of
from ..errors import SensorError
from ..experiment.session import run_presses
from ..measure.force.calibration import load_force
from ..measure.shape import DepthModel
from ..patterns.recipe import PatternRecipe, recipe_from
from ..protocols.plan import Protocol
from ..rig.config import VirtualConfig
from ..rig.interface import RigSetup as RigJob
from ..shapes import SensorDimensions
from ..virtual.rig import VirtualKind
from .stream import PressStream

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
def carried_out(told: dict[str, Any]) -> Iterator[tuple[Run, dict[str, Any]]]:
    """The finished run of a press, until the end of the block, and what the gel reports of it.

    told: as `given`, with recipe, press and seed. Raises RunFailed.
    """
    import cv2

    protocol, sensor, rig, source = read(told)
    with TemporaryDirectory(prefix="deltact-fab-") as scratch:
        recipe = catalog.validate(PatternRecipe, told["recipe"], "recipe")
        view = VirtualKind(rig, source).camera(protocol, sensor)
        job = RigJob(protocol, sensor, recipe, view, told["seed"], Path(scratch) / protocol.name)
        cv2.setNumThreads(1)  # a processor has a job of its own
        bench = run_presses(job, rig, source, [told["press"]])
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
            flags.setdefault(flag.id, flag.labelled)
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


# CPU seconds on one core, about, for the time that is announced beforehand.
GEOMETRY_S, PATTERN_S, PRINT_S = 0.2, 0.45, 1.2
FIGURES = ("mean_at_dots_mm", "mean_off_dots_mm", "lost_share")
"""Columns of a job's table of frames."""


def cost_s(frames: int, patterns: int) -> float:
    """Seconds of one core that a job takes, about."""
    return frames * (GEOMETRY_S + patterns * PATTERN_S) + patterns * PRINT_S


def follow(given: dict[str, Any]) -> dict[str, Any]:
    """Every frame of a press, its geometry and truth once, tracked under every pattern.

    given: as `given`, with press, patterns (recipes by name), methods and seed. Returns
    what `packed` does, `frames`, and `gel` (its flags). Raises SolverError where the gel cannot be
    solved or drawn.
    """
    import cv2

    cv2.setNumThreads(1)  # the other cores have jobs of their own
    protocol, sensor, config, source = read(given)
    stream = PressStream(protocol, given["press"], sensor, config, source)
    seed, methods = given["seed"], given["methods"]
    printed, followers = {}, {}
    for name, data in given["patterns"].items():
        recipe = recipe_from(data, name)
        marks = stream.marks(recipe)
        printed[name] = stream.picture(recipe, seed), stream.noise(seed)
        followers[name] = Follower(
            TrackingPlan(tuple(methods), bool(len(marks.dots_mm)), (), timed=False), marks
        )
    rows: dict[str, dict[str, list[dict[str, Any]]]] = {
        name: {method: [] for method in methods} for name in printed
    }
    lost: dict[str, list[str]] = {}
    for frame in stream.frames():
        for name, (picture, noise) in printed.items():
            if name in lost:
                continue
            image = stream.tracked(picture.expose(frame.at_px, noise, frame.displacement_mm))
            try:
                said = followers[name].take(image, frame.true)
            except SensorError as why:  # a print that the camera cannot tell from grey
                lost[name] = [str(why)]
                continue
            for method, figures in said.items():
                rows[name][method].append(figures)
    found = {
        name: (
            one.tallies, rows[name], one.dots.tally.figures() if one.dots else None,
            lost.get(name, one.left_out),
        )
        for name, one in followers.items()
    }  # fmt: skip
    return {
        "frames": len(stream.looks),
        "gel": {"flags": stream.solver.flags},
        **packed([look.tip_mm for look in stream.looks[1:]], stream.path.at_mm, found),
    }


def packed(
    tips_mm: Sequence[Sequence[float]], at_mm: Sequence[float], found: Mapping[str, Any]
) -> dict[str, Any]:
    """A press as a grid keeps it, and `pattern_errors.cells_of` reads it.

    tips_mm (n, 3): at all frames but the first; at_mm: where the press is. found: by pattern its
    tallies, kept without times, and rows of figures by method, its dots' figures, and what was
    left out.
    """
    x, y, z = np.array(tips_mm, float).reshape(-1, 3).T
    path = np.column_stack((np.maximum(-z, 0.0), np.hypot(x - at_mm[0], y - at_mm[1])))
    cells = [
        {
            "pattern": name,
            "tallies": {method: replace(tally, ms=[]) for method, tally in tallies.items()},
            "rows": {
                method: np.array([[row.get(key) for key in FIGURES] for row in rows[method]], float)
                .reshape(-1, len(FIGURES))
                for method in tallies
            },
            "dots": dots,
            "left_out": left_out,
        }
        for name, (tallies, rows, dots, left_out) in found.items()
    ]  # fmt: skip
    return {"path": path, "cells": cells}


def follow_recorded(given: dict[str, Any]) -> dict[str, Any]:
    """One press of a run, as `follow` returns one of a simulated gel."""
    run, name = record.open(given["folder"]), given["name"]
    scene = tracking_plan_of(run, given["methods"])
    found = analyse_press(given["folder"], given["press"], scene)
    rows = {m: [row for row in found.rows if row["method"] == m] for m in given["methods"]}
    tips = run.frames(given["press"])[["x_mm", "y_mm", "z_mm"]].to_numpy(float)
    here = {name: (found.tallies, rows, found.dots.figures(), found.left_out)}
    return packed(tips[1:].tolist(), tips[0, :2].tolist(), here)
