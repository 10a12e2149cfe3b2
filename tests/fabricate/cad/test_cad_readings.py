"""Readings of the coupons: known machines are found again, bad tables are one line."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from deltact_fab.app.cli.main import main
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad.check import arithmetic
from deltact_fab.fabricate.cad.check.row import mark_unverified
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.fabrication.readings import Reading, fit_readings, read_readings

HEAD = "coupon,feature,nominal_mm,measured_mm,pieces\n"
HOLE, OUTSIDE, KERF, OFF = -0.06, 0.03, 0.17, 0.02


def made(rng: np.random.Generator, each: int) -> list[Reading]:
    """Readings of a printer and a laser whose bias and standard deviation are known."""

    def lot(coupon, feature, nominal, bias):
        return [
            Reading(coupon, feature, nominal, nominal + bias + rng.normal(0, OFF))
            for _ in range(each)
        ]

    return [
        *lot("fit-coupon", "hole", 3.0, HOLE),
        *lot("fit-coupon", "slot", 3.5, HOLE),
        *lot("fit-coupon", "outside", 8.0, OUTSIDE),
        *lot("fit-coupon", "height", 13.0, 0.02),
        *lot("kerf-coupon", "strip", 10.0, -KERF),
        *lot("kerf-coupon", "thickness", 2.0, -0.05),
        Reading("kerf-coupon", "strip", 100.0, 100.0 - 10 * KERF, 10),
    ]


def test_known_machine_is_recovered():
    found = {e.key: e for e in fit_readings(made(np.random.default_rng(2), 400), Design())}
    assert found["resin_printer.hole_bias_mm"].value == pytest.approx(HOLE, abs=0.004)
    assert found["resin_printer.outside_bias_mm"].value == pytest.approx(OUTSIDE, abs=0.004)
    assert found["laser.kerf_mm"].value == pytest.approx(KERF, abs=0.004)
    # 95 % of a normal distribution lie within 1.96 standard deviations.
    assert found["resin_printer.plane_mm"].value == pytest.approx(1.96 * OFF, rel=0.1)
    assert found["laser.tolerance_mm"].value == pytest.approx(1.96 * OFF, rel=0.1)
    assert found["resin_printer.height_mm"].value == pytest.approx(0.02 + 1.96 * OFF, rel=0.1)
    share = (0.05 + 1.96 * OFF) / 2
    assert found["laser.sheet_tolerance"].value == pytest.approx(share, rel=0.1)


def test_spread_covers_95_percent():
    rng, inside, rounds = np.random.default_rng(7), 0, 2000
    for _ in range(rounds):
        off = rng.normal(0, OFF, 5)
        lot = [Reading("fit-coupon", "hole", 3.0, 3.0 + float(v)) for v in off]
        bias, plane = fit_readings(lot, Design())
        assert plane.key == "resin_printer.plane_mm"
        inside += abs(rng.normal(0, OFF) - bias.bias_mm) <= plane.spread_mm
    assert inside / rounds == pytest.approx(0.95, abs=0.015)


def test_compensated_path_adds_to_kerf():
    strips = [Reading("kerf-coupon", "strip", 100.0, 99.9, 10)]
    (told,) = fit_readings(strips, load_design("deltact", ["laser.compensate=true"]))
    assert told.value == pytest.approx(0.2 + 0.01)
    assert math.isnan(told.spread_mm)


def test_fitted_design_checks_and_exports(tmp_path):
    table, mine = tmp_path / "readings.csv", tmp_path / "mine.toml"
    lines = [f"{r.coupon},{r.feature},{r.nominal_mm},{r.measured_mm:.3f},{r.pieces}"
             for r in made(np.random.default_rng(3), 8)]  # fmt: skip
    table.write_text(HEAD + "\n".join(lines) + "\n")
    told = CliRunner().invoke(main, ["cad", "fit", str(table), "-o", str(mine)])
    assert told.exit_code == 0, told.output
    assert "resin_printer.plane_mm" in told.output
    design = load_design(str(mine))
    assert design.resin_printer.hole_bias_mm == pytest.approx(HOLE, abs=0.03)
    open_keys = design.unverified()
    assert "resin_printer.plane_mm" not in open_keys
    assert "resin_printer.bed_x_mm" in open_keys
    rows = mark_unverified(arithmetic.fits(design), design)
    (pocket,) = [r for r in rows if r.value.startswith("plate in its pocket, x")]
    assert (pocket.status, pocket.basis) == ("pass", ())
    again = CliRunner().invoke(main, ["cad", "fit", str(table), "--design", str(mine), "--json"])
    rows = {row["key"]: row for row in json.loads(again.output)}
    assert rows["laser.kerf_mm"]["before"] == rows["laser.kerf_mm"]["value"]


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (
            "fit-coupon,hole,3.0,two,",
            "line 3: measured_mm: must be a number without a unit (got 'two')",
        ),
        ("fit-coupon,hole,-3,3,", "line 3: nominal_mm: must be greater than 0 (got -3)"),
        ("fit-coupon,hole,3.0,30,", "line 3: measured_mm 30: expected within 50% of nominal_mm 3"),
        ("fit-coupon,strip,3.0,3,", "line 3: feature 'strip'"),
        ("fit-coupon,hole,3.0,3,2", "line 3: pieces 2: expected 1"),
        ("fit-coupon,hole,3.0,3,1,7", "line 3: beyond the last column: unknown key"),
        ("fit-coupon,hole,3.0,3,", "hole and slot: 2 readings; expected 3 or more"),
    ],
)
def test_bad_table_names_its_place(tmp_path, line, says):
    table = tmp_path / "readings.csv"
    table.write_text(HEAD + "fit-coupon,hole,3.0,2.95,\n" + line + "\n")
    with pytest.raises(InputError) as why:
        fit_readings(read_readings(table), Design())
    assert says in str(why.value)
    assert "\n" not in str(why.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no reading below a header of coupon, feature, nominal_mm"),
        (HEAD, "no reading"),
        ("coupon,feature,nominal_mm\nfit-coupon,hole,3\n", "line 2: measured_mm: missing key"),
        (
            HEAD.replace("pieces", "pices") + "fit-coupon,hole,3,3,1\n",
            "line 2: pices: unknown key; did you mean 'pieces'",
        ),
    ],
)
def test_bad_header_gives_one_line(tmp_path, text, says):
    table = tmp_path / "readings.csv"
    table.write_text(text)
    with pytest.raises(InputError, match=says):
        read_readings(table)


def test_how_to_example_is_read(tmp_path):
    guide = Path(__file__).parents[3] / "docs" / "how-to" / "measure-your-printer.md"
    (block,) = re.findall(r"```csv\n(.*?)```", guide.read_text(), re.S)
    table = tmp_path / "readings.csv"
    table.write_text(block)
    found = {e.key: e.value for e in fit_readings(read_readings(table), Design())}
    assert set(found) == {
        f"resin_printer.{key}_mm" for key in ("hole_bias", "outside_bias", "plane", "height")
    } | {"laser.kerf_mm", "laser.tolerance_mm", "laser.sheet_tolerance"}
    assert found["laser.kerf_mm"] == pytest.approx((1.8 + 0.17 + 0.2 + 0.18) / 13, abs=5e-4)
