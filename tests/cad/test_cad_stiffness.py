"""The acrylic plate under a press: textbook plates, then the design's own, then finite elements."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from plate_in_calculix import solve

from deltact_fab.cad.check import bending
from deltact_fab.cad.check.built import BuiltDesign
from deltact_fab.cad.check.row import verified
from deltact_fab.cad.design import load_design
from deltact_fab.cad.stiffness import PlateShape, bend, plate_of, press

DEFAULT = load_design()
SQUARE = PlateShape((10.0, 10.0), (0.0, 0.0), (10.0, 10.0), 1.0, 3000.0, 0.3)


def test_a_supported_square_is_that_of_the_textbook():
    # Concentrated load: Table 23, w = .01160 P a^2 / D. A small disc yields nearly as far.
    found = bend(SQUARE, 0.02, terms=24).deflection_mm * SQUARE.rigidity_nmm / 20**2
    assert found == pytest.approx(0.01160, rel=5e-3)


def test_two_free_edges_of_a_narrow_strip_are_a_beam():
    strip = PlateShape((1.0, 20.0), (0.0, 0.0), (None, 20.0), 0.5, 3000.0, 0.0)
    beam_mm = 40**3 / (48 * 3000 * 2 * 0.5**3 / 12)
    found = bend(strip, 0.5)
    assert found.deflection_mm == pytest.approx(beam_mm, rel=5e-3)
    narrow = 40 / 4 / (2 * 0.5**2 / 6)
    assert bend(strip, 1.9).stress_mpa == pytest.approx(narrow * (1 - 0.9 / 20), rel=0.05)


def test_more_terms_yield_more_and_end():
    found = [bend(plate_of(DEFAULT), 22.0, terms=n).deflection_mm for n in (6, 8, 10, 14, 20)]
    assert found == sorted(found)
    assert found[-2] == pytest.approx(found[-1], rel=2e-3)


def test_notches_and_free_edges_let_it_yield_more():
    plate = plate_of(DEFAULT)
    whole = replace(plate, notch_mm=(0.0, 0.0))
    two = replace(plate, support_mm=(None, plate.support_mm[1]))
    base = bend(plate, 22.0).deflection_mm
    assert bend(whole, 22.0).deflection_mm < base
    assert bend(two, 22.0).deflection_mm > 2 * base


def test_a_press_goes_with_force_place_and_modulus():
    one, two = press(DEFAULT, 1.0, (3.0, -2.0)), press(DEFAULT, 2.0, (-3.0, 2.0))
    assert two.deflection_mm == pytest.approx(2 * one.deflection_mm)
    soft = load_design(changes=["plate.youngs_modulus_mpa=1500"])
    assert press(soft, 1.0).deflection_mm == pytest.approx(2 * press(DEFAULT, 1.0).deflection_mm)
    assert press(soft, 1.0).stress_mpa == pytest.approx(press(DEFAULT, 1.0).stress_mpa)
    # Over the light holder, which stands round the middle, the plate yields less.
    assert press(DEFAULT, 1.0).over_ring_mm < 0.7 * press(DEFAULT, 1.0).deflection_mm


@pytest.mark.parametrize(
    ("name", "changes", "fails"),
    [
        ("deltact", [], []),
        ("skin-30x34", [], []),
        ("skin-44x40", [], []),
        ("deltact", ["optics.acrylic_mm=1"], ["deflection", "clear"]),
        ("deltact", ["shell.ledge_x_mm=0"], ["deflection", "clear"]),
        ("deltact", ["light.axial_fit_mm=0.1"], ["clear"]),
        ("deltact", ["plate.force_n=271"], ["deflection", "clear", "stress"]),
        ("deltact", ["plate.stress_limit_mpa=8"], ["stress"]),
        ("skin-44x40", ["optics.acrylic_mm=2"], ["deflection", "clear"]),
    ],
)
def test_rows_hold_the_plate_against_its_limits(name, changes, fails):
    built = BuiltDesign(load_design(name, changes), (), {})
    failing = [row.check.split()[1] for row in bending.rows(built) if not row.passed]
    assert failing == fails


def test_a_row_says_when_it_rests_on_what_nobody_measured():
    row, *_ = verified(bending.rows(BuiltDesign(DEFAULT, (), {})), DEFAULT)
    assert row.verdict == "pass (unverified: spread, youngs modulus)"
    assert row.found.startswith("0.199 mm under 49 N: 4.0 %")
    keys = '["spread_mm", "youngs_modulus_mpa", "stress_limit_mpa"]'
    known = load_design(changes=[f"plate.measured={keys}"])
    assert [*verified(bending.rows(BuiltDesign(known, (), {})), known)][-1].verdict == "pass"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
@pytest.mark.parametrize("four", [True, False])
def test_within_a_tenth_of_solid_elements_at_49_n(tmp_path, four):
    plate = plate_of(DEFAULT)
    if not four:
        plate = replace(plate, support_mm=(None, plate.support_mm[1]))
    sx, sy = plate.support_mm

    def line(at):
        """The inner edges of the ledges, at the plate's back."""
        on = np.abs(at[:, 1] - sy) < 1e-9
        if sx is not None:
            on |= np.abs(at[:, 0] - sx) < 1e-9
        return on & (at[:, 2] == 0)

    def ledge(at):
        """The whole breadth of the ledges."""
        on = at[:, 1] > sy - 1e-9
        if sx is not None:
            on |= at[:, 0] > sx - 1e-9
        return on & (at[:, 2] == 0)

    force_n, spread_mm = 49.0, 22.0
    exact = solve(plate, force_n, spread_mm, line, tmp_path)
    found = bend(plate, spread_mm, ring_mm=(DEFAULT.light_bore_mm, DEFAULT.light_radius_mm))
    back = exact.places[:, 2] == 0
    sag = -exact.moved[:, 2]
    middle = exact.at(0, 0, 0)
    radius = np.hypot(*exact.places[:, :2].T)
    over = back & (radius >= DEFAULT.light_bore_mm) & (radius <= DEFAULT.light_radius_mm)
    assert force_n * found.deflection_mm == pytest.approx(sag[back].max(), rel=0.1)
    assert force_n * found.over_ring_mm == pytest.approx(sag[over].max(), rel=0.1)
    assert force_n * found.stress_mpa == pytest.approx(exact.stresses[middle, :2].max(), rel=0.1)
    # What would hold the plate on the ledges' whole breadth makes it stiffer, so the row is safe.
    held = solve(plate, force_n, spread_mm, ledge, tmp_path)
    assert -held.moved[middle, 2] < 0.6 * sag[middle]


def test_a_press_on_the_ledge_alone_bends_nothing() -> None:
    found = bend(plate_of(DEFAULT), 2.0, at_mm=(30.0, 0.0))
    assert (found.deflection_mm, found.over_ring_mm, found.stress_mpa) == (0.0, 0.0, 0.0)
