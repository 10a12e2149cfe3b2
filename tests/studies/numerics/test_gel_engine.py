"""The gel's engine: its truths and its judges."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.physics.gel.level_selection import FORCE_TOLERANCE
from deltact_fab.physics.gel.press import PressOutcome
from deltact_fab.studies.numerics.engines import gel


def test_true_press_measures_errors() -> None:
    truth = gel.load_truths()[0]
    x = y = np.linspace(-5, 5, 21)
    off_mm = np.array([0.003, -0.004])
    r = np.hypot(*np.meshgrid(x, y))
    radial = np.interp(r, gel.RADII_STEP_MM * np.arange(len(truth.radial_mm)), truth.radial_mm)
    field = np.stack(np.meshgrid(x, y), axis=-1) * (radial / np.maximum(r, 1e-12))[..., None]
    u = np.dstack([field + off_mm, np.zeros_like(r)])
    result = {"force_n": [0.0, 0.0, 1.02 * truth.force_n[2]]}
    press = PressOutcome(result, np.empty(0), np.empty(0), x, y, u)
    assert truth.force_percent(press) == pytest.approx(2.0)
    inside = (r <= truth.side_mm[0] / 2 - truth.thickness_mm).mean()
    assert truth.in_plane_mm(press) == pytest.approx(0.005 * np.sqrt(inside), rel=1e-6)


def test_curves_have_outside_truths_and_defaults() -> None:
    settings = gel.curves()
    assert {s.kind for s in settings} == {"independent solver"}
    assert {t.solver.split(",")[0] for t in gel.load_truths()} == {"axisymmetric", "3D"}
    default = {s.case: s.name for s in settings if s.recommended}
    assert set(default) == {s.case for s in settings}
    assert set(default.values()) == {f"tolerance {FORCE_TOLERANCE:g}", "8000 unknowns"}
