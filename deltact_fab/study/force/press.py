"""The job of the force study: presses as points of a fit.

Each is carried out on the virtual rig as a run has it, and its record analysed as any other; then
the images go, and the points stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from ...analysis.force.dataset import PressPoints, points_of
from ...analysis.view import view_of
from .. import press_jobs

_ROW = ("frame_id", "indenter", "run", "press", "position", "x_mm", "y_mm", "cover", "wait_s")


def points(told: dict[str, Any]) -> dict[str, Any]:
    """The points of presses: rows (lists by column), wrench (n, 6), features (n, k) by name.

    And what `press_jobs.gel_of` reports. told: as `press_jobs.given`, and names of `features`.
    Raises RunFailed.
    """
    with press_jobs.carried_out(told) as (run, bench):
        name = str(told["protocol"]["name"])
        parts = [points_of(run, name, p, told["features"], view_of(run)) for p in told["presses"]]
    return {**_packed(parts), **press_jobs.gel_of(bench)}


def unpacked(value: dict[str, Any]) -> PressPoints:
    """The points of a job's value."""
    rows = pd.DataFrame(value["rows"])
    return PressPoints(rows, value["wrench"], value["features"], value["refused"])


def _packed(parts: Sequence[PressPoints]) -> dict[str, Any]:
    rows = pd.concat([part.rows for part in parts], ignore_index=True)
    return {
        "rows": {name: rows[name].tolist() for name in _ROW},
        "wrench": np.concatenate([part.wrench for part in parts]),
        "refused": [why for part in parts for why in part.refused],
        "features": {
            name: np.concatenate([part.features[name] for part in parts])
            for name in parts[0].features
        },
    }
