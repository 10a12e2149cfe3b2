"""The jobs of the study of shapes: the ball that calibrates the depth, and presses of an object.

Calibrations come as the text of their files, so that a job depends on nothing of its caller.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ...analysis.shape import UNCALIBRATED, PressShape, ShapeMaps, calibrate_depth, press_shape
from ...measure.force.calibration import ForceCalibration, load_force
from ...measure.sensor_id import Kind
from ...measure.shape import DepthModel
from .. import press_jobs

SHOWN = ("deepest", "twisted")
"""Pictures of a press."""


def ball(told: dict[str, Any]) -> dict[str, Any]:
    """A calibration of depth by the first ball that is pressed; told: as `press_jobs.given`."""
    with press_jobs.carried_out(told) as (run, bench):
        found = calibrate_depth(run.folder)
        return {"toml": found.toml(), "line": found.line, **press_jobs.gel_of(bench)}


def look(told: dict[str, Any]) -> dict[str, Any]:
    """What is seen of one press, and what is true of it; told: as `press_jobs.given`, of one press.

    And `depth`, `force`: texts of calibrations, None for none.
    """
    (press,) = told["presses"]
    with press_jobs.carried_out(told) as (run, bench), TemporaryDirectory() as folder:
        files: dict[Kind, Path] = {}
        kinds: tuple[Kind, ...] = ("depth", "force")
        for kind in kinds:
            if told[kind] is not None:
                files[kind] = Path(folder) / f"{kind}.toml"
                files[kind].write_text(told[kind], encoding="utf-8")
        seen = press_shape(run.folder, press, *models(files))
        return {**packed(seen), **press_jobs.gel_of(bench)}


def models(files: Mapping[Kind, Path]) -> tuple[DepthModel, ForceCalibration | None]:
    """Of calibration files by kind. Without one of depth the inverse's own is taken."""
    depth = DepthModel.load(files["depth"])[1] if "depth" in files else UNCALIBRATED
    return depth, load_force(files["force"]) if "force" in files else None


def packed(seen: PressShape) -> dict[str, Any]:
    """As a grid keeps it: plain data, and arrays at the top level."""
    value: dict[str, Any] = {"rows": seen.rows, "contact_by": seen.contact_by}
    for name in SHOWN:
        picture = getattr(seen, name)
        if picture is not None:
            value |= picture.as_value(f"{name}/")
    return value


def unpacked(value: Mapping[str, Any]) -> PressShape:
    """What `packed` gave."""
    rows: Sequence[dict[str, Any]] = value["rows"]
    pictures = [
        ShapeMaps.of_value(value, f"{name}/") if f"{name}/frame_id" in value else None
        for name in SHOWN
    ]
    return PressShape(list(rows), pictures[0], pictures[1], value["contact_by"])
