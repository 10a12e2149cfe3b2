"""The jobs of the study of shapes: the ball that calibrates the depth, and presses of an object.

Calibrations come as the text of their files, so that a job depends on nothing of its caller.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ...analysis.shape import PressShape, ShapeMaps, calibrate_depth, press_shape
from ...measure.force.calibration import load_force
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

    And `depth`, `force`: texts of calibrations.
    """
    (press,) = told["presses"]
    with press_jobs.carried_out(told) as (run, bench), TemporaryDirectory() as folder:
        files = [Path(folder) / f"{kind}.toml" for kind in ("depth", "force")]
        for file in files:
            file.write_text(told[file.stem], encoding="utf-8")
        depth, force = files
        seen = press_shape(run.folder, press, DepthModel.load(depth)[1], load_force(force))
        pictures = {name: getattr(seen, name) for name in SHOWN}
        return {
            "rows": seen.rows,
            "contact_by": seen.contact_by,
            **{name: None if one is None else vars(one) for name, one in pictures.items()},
            **press_jobs.gel_of(bench),
        }


def unpacked(value: Mapping[str, Any]) -> PressShape:
    """What `look` found."""
    deepest, twisted = (value[name] and ShapeMaps(**value[name]) for name in SHOWN)
    return PressShape(value["rows"], deepest, twisted, value["contact_by"])
