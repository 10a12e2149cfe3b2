"""The gel's engine: its truths and its judges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deltact_fab.physics.gel.level_selection import FORCE_TOLERANCE
from deltact_fab.physics.gel.press import PressOutcome
from deltact_fab.studies.numerics.engines import gel, gel_press
from deltact_fab.studies.numerics.engines.gel_press import FiniteSolution, GelCase


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
    settings = gel.curves(False)
    assert {s.kind for s in settings} == {"independent solver"}
    assert {t.solver.split(",")[0] for t in gel.load_truths()} == {"axisymmetric", "3D"}
    default = {s.case: s.name for s in settings if s.recommended}
    assert default == dict.fromkeys({s.case for s in settings}, f"tolerance {FORCE_TOLERANCE:g}")


@pytest.mark.slow
@pytest.mark.parametrize("truth", gel.load_truths(), ids=lambda truth: truth.name)
def test_estimate_covers_stored_truths(truth: gel.TruePress) -> None:
    press = truth.solve()
    estimate = press.result["error_estimate"]
    assert truth.force_percent(press) / 100 <= estimate["force_rel"] + truth.error_rel
    if truth.radial_mm:
        assert truth.in_plane_mm(press) <= estimate["displacement_mm"]


@pytest.fixture(scope="module")
def found() -> FiniteSolution:
    return gel_press.solve_press(GelCase(spacing_mm=3.0), 0.3, (0.0, 0.0, 3.0))


def test_checks_detect_errors(found: FiniteSolution) -> None:
    assert abs(gel_press.work_error_percent(found)) < 0.5
    assert gel_press.imbalance(found) < 1e-6
    stronger = [replace(s, force_n=tuple(1.02 * f for f in s.force_n)) for s in found.states]
    wrong = FiniteSolution(found.press, tuple(stronger))
    assert gel_press.work_error_percent(wrong) > 1.5
    assert gel_press.imbalance(wrong) > 0.01


def test_excess_shear_is_detected() -> None:
    scene = GelCase(spacing_mm=3.0, friction=0.5, mirrors=(False, True))
    rubbed = gel_press.solve_press(scene, 1.5, (0.0, 0.0, 3.0), (1.0, 0.0, 3.0))
    assert gel_press.cone_excess(rubbed) < 5e-3
    more = replace(rubbed.last, shear_mpa=1.1 * rubbed.last.shear_mpa)
    assert gel_press.cone_excess(FiniteSolution(rubbed.press, (more,))) > 0.05
