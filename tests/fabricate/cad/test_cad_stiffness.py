"""The acrylic plate under a press: textbook plates, then the design's own, then finite elements."""

from __future__ import annotations

from dataclasses import replace

import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad.check.arithmetic import bending
from deltact_fab.fabricate.cad.check.row import mark_unverified, shorten_key
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.stiffness import PlateShape, bend, plate_of, press_plate

DEFAULT = load_design()
LONG = PlateShape((30.0, 10.2), (0.0, 0.0), (30.0, 10.0), 1.0, 3000.0, 0.3, 0.0, 1e4)


def test_long_plate_matches_textbook():
    # A concentrated load: Table 23, b / a infinite: w = 0.01695 P a^2 / D.
    found = bend(LONG, 0.02, terms=22).deflection_mm * LONG.rigidity_nmm / 20**2
    assert found == pytest.approx(0.01695, rel=0.015)


def test_narrow_strip_is_a_beam():
    strip = replace(LONG, half_mm=(1.0, 20.2), support_mm=(1.0, 20.0), thickness_mm=0.5, poisson=0)
    beam_mm = 40**3 / (48 * 3000 * 2 * 0.5**3 / 12)
    assert bend(strip, 0.5).deflection_mm == pytest.approx(beam_mm, rel=5e-3)
    narrow = 40 / 4 / (2 * 0.5**2 / 6)
    assert bend(strip, 1.9).stress_mpa == pytest.approx(narrow * (1 - 0.9 / 20), rel=0.05)


def test_rigid_plate_tilts_on_bead():
    # Two strips of 4 x 20 mm at +-8 mm of y, 1 mm high: S = 2, 4/3 E (1 + S^2) = 3.33 N/mm3.
    stiff = replace(LONG, half_mm=(10.0, 10.0), support_mm=(10.0, 6.0), thickness_mm=50.0)
    plate = replace(stiff, bead_mm=1.0, bead_modulus_mpa=0.5)
    assert bend(plate, 1.0).deflection_mm == pytest.approx(1 / (2 * 80 * 10 / 3), rel=5e-3)
    # 2 mm off the middle both still push; 9 mm off, more than the far one lets go.
    ends_mm = 1 / (160 * 10 / 3) * (1 + 2 * 10 / (8**2 + 4**2 / 12))
    assert bend(plate, 1.0, (0.0, 2.0)).deflection_mm == pytest.approx(ends_mm, rel=0.01)
    pulling_mm = 1 / (160 * 10 / 3) * (1 + 9 * 10 / (8**2 + 4**2 / 12))
    assert bend(plate, 1.0, (0.0, 9.0)).deflection_mm > 1.05 * pulling_mm


@pytest.mark.parametrize("bead", [(0.0, 1.15), (0.5, 1.15)])
def test_series_converges_with_terms(bead):
    plate = replace(plate_of(DEFAULT), bead_mm=bead[0], bead_modulus_mpa=bead[1])
    found = [bend(plate, 22.0, terms=n).deflection_mm for n in (6, 10, 14, 18)]
    assert found == pytest.approx(sorted(found), rel=3e-3)
    assert found[-2] == pytest.approx(found[-1], rel=3e-3)


def test_bead_limits_hard_and_soft():
    plate = plate_of(DEFAULT)
    bare, *thicker = (bend(replace(plate, bead_mm=t), 22.0).deflection_mm for t in (0.0, 0.02, 0.5))
    assert [bare, *thicker] == sorted([bare, *thicker])
    assert thicker[0] == pytest.approx(bare, rel=0.01)
    hard = replace(plate, bead_modulus_mpa=1e4)
    assert bend(hard, 22.0).deflection_mm == pytest.approx(bare, rel=0.03)
    soft = replace(plate, bead_modulus_mpa=0.05, bead_mm=5.0)
    sides = zip(plate.half_mm, plate.support_mm, plate.notch_mm, plate.half_mm[::-1], strict=True)
    per_mm = sum(
        4 / 3 * 0.05 * (1 + ((half - inner) / 10) ** 2) / 5 * (half - inner) * 4 * (along - notch)
        for half, inner, notch, along in sides
    )
    assert bend(soft, 22.0).deflection_mm == pytest.approx(1 / per_mm, rel=0.03)


def test_deflection_scales_with_force():
    one, two = press_plate(DEFAULT, 1.0, (3.0, -2.0)), press_plate(DEFAULT, 2.0, (-3.0, 2.0))
    assert two.deflection_mm == pytest.approx(2 * one.deflection_mm)
    soft = load_design(changes=["plate.youngs_modulus_mpa=1500", "plate.bead_modulus_mpa=0.575"])
    half, whole = press_plate(soft, 1.0), press_plate(DEFAULT, 1.0)
    assert half.deflection_mm == pytest.approx(2 * whole.deflection_mm, rel=1e-3)
    assert half.stress_mpa == pytest.approx(whole.stress_mpa, rel=1e-3)
    # Over the light holder, which stands round the middle, the plate yields less.
    assert press_plate(DEFAULT, 1.0).over_ring_mm < 0.7 * press_plate(DEFAULT, 1.0).deflection_mm


@pytest.mark.parametrize(
    ("name", "changes", "fails"),
    [
        ("large-60x50", [], ()),
        ("deltact", ["optics.acrylic_mm=1"], ("deflection", "clear")),
        ("deltact", ["shell.ledge_x_mm=0"], ("deflection", "clear")),
        ("deltact", ["plate.bead_modulus_mpa=0.3"], ("deflection", "clear")),
        ("deltact", ["light.axial_fit_mm=0.9"], ("clear",)),
        ("deltact", ["plate.stress_limit_mpa=8"], ("stress",)),
        ("deltact", ["plate.spread_mm=35"], ("load",)),
    ],
)  # fmt: skip
def test_rows_check_plate_limits(name, changes, fails):
    rows = bending(load_design(name, changes))
    assert fails == tuple(row.name.split()[1] for row in rows if row.failed)


def test_row_names_bead_and_unverified():
    row, *_ = mark_unverified(bending(DEFAULT), DEFAULT)
    assert list(map(shorten_key, row.basis)) == ["spread", "youngs modulus", "bead modulus"]
    assert row.value.startswith("0.220 mm under 49 N, 0.051 mm from the bead; 4.4 %")
    keys = '["spread_mm", "youngs_modulus_mpa", "stress_limit_mpa", "bead_modulus_mpa"]'
    known = load_design(changes=[f"plate.measured={keys}"])
    assert [*mark_unverified(bending(known), known)][-1].basis == ()


def test_plate_without_ledge_is_refused():
    changes = ["frame.seat_y_mm=0.2", "shell.ledge_mm=0.2", "plate.fit_mm=0.5"]
    with pytest.raises(InputError, match=r"no ledge in y; raise shell\.ledge_mm"):
        press_plate(load_design(changes=changes), 1.0)


def test_press_beyond_plate_bends_nothing() -> None:
    found = bend(plate_of(DEFAULT), 2.0, at_mm=(30.0, 0.0))
    assert (found.deflection_mm, found.over_ring_mm, found.stress_mpa) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("changes", "deflection_mm", "over_ring_mm", "stress_mpa"),
    [
        ((), 0.223, 0.140, 8.62),
        (("shell.ledge_drop_mm=1.0", "shell.ledge_mm=1.5", "shell.ledge_x_mm=1.15"),
         0.438, 0.330, 10.19),
        (("shell.ledge_drop_mm=0", "shell.ledge_x_mm=0"), 0.365, 0.353, 12.82),
    ],
)  # fmt: skip
def test_within_six_percent_of_fem(changes, deflection_mm, over_ring_mm, stress_mpa):
    """CalculiX 2.20, C3D20R, by benchmarks/peers/plate_in_calculix.py."""
    found = press_plate(load_design(changes=changes), 49.0)
    assert found.deflection_mm == pytest.approx(deflection_mm, rel=0.06)
    assert found.over_ring_mm == pytest.approx(over_ring_mm, rel=0.06)
    assert found.stress_mpa == pytest.approx(stress_mpa, rel=0.06)
