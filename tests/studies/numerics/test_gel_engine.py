"""The gel's engine: its reference and its judges."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks import gel_press as evidence
from deltact_fab.studies.numerics.engines import gel_press
from deltact_fab.studies.numerics.engines.gel_press import FiniteSolution, GelCase

SLOW = pytest.mark.slow


def test_extrapolation_removes_second_order_error() -> None:
    field = np.random.default_rng(0).standard_normal((5, 4, 2))
    off = np.random.default_rng(1).standard_normal((5, 4, 2))
    cells = (0.75, 0.5)
    found = gel_press.extrapolate(
        [40 + 3 * h**2 for h in cells], [field + off * h**2 for h in cells], cells
    )
    assert found.normal_n == pytest.approx(40, rel=1e-12)
    assert np.abs(found.in_plane_mm - field).max() < 1e-12
    assert found.force_error == pytest.approx(100 * (1 - 40 / 40.75), rel=1e-9)
    assert found.in_plane_error == pytest.approx(0.25 * gel_press.rms_mm(off), rel=1e-9)


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


@pytest.mark.parametrize(
    ("of", "what", "own"),
    [
        pytest.param(of, *item, marks=SLOW if item[0][1] is True else pytest.mark.evidence)
        for of, table in ((gel_press.reference, gel_press.REFERENCE_ERROR),
                          (evidence.reference, evidence.OWN_ERROR)) for item in table.items()
    ],
)  # fmt: skip
def test_reference_error_is_as_stated(of: Any, what: tuple[Any, ...], own: Any) -> None:
    truth = of(*what)
    assert truth.force_error <= own[0] * 1.1
    assert truth.in_plane_error <= own[1] * 1.1
