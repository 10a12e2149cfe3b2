"""The studies by name; a study's module is imported only when it is run."""

from __future__ import annotations

import importlib

from ..errors import InputError, did_you_mean
from ..report.result import StudyResult
from .asked import Asked

STUDIES = {
    "force-calibration": ("force_calibration", "The paper's force table: 5 balls, 2070 points."),
    "pattern-selection": ("pattern_selection", "The paper's 17 patterns under 5 indenters."),
    "shapes": ("shapes", "Sphere, cylinder, ring, toy hat: depth against truth; force fields."),
    "comparison": ("comparison", "The paper's table of sensors, with your designs as rows."),
    "pattern-search": ("pattern_search", "The best pattern for a printer and a camera."),
    "settling": ("settling", "How long to wait at a stop before the force is steady."),
}
"""name: (module, one line of help)."""


def run(name: str, asked: Asked) -> StudyResult:
    """Run a study. Raises InputError for an unknown one or bad options, RunFailed."""
    if name not in STUDIES:
        raise InputError(f"{name}: no such study{did_you_mean(name, STUDIES)}")
    module = importlib.import_module(f"deltact_fab.study.{STUDIES[name][0]}")
    result = module.run(asked)
    assert isinstance(result, StudyResult)
    return result
