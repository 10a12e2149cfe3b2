"""`gel fit`: what is found in synthetic presses, and what is refused or told."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from deltact_fab.cli.gel import fit as command
from deltact_fab.elasticity.material import GelMaterial
from deltact_fab.errors import InputError, RunFailed
from deltact_fab.gel.fit.fit import GelFit, fit_press
from deltact_fab.gel.fit.force_curve import ForceCurve, force_curve, force_path
from deltact_fab.gel.fit.measured import MeasuredIndentation, read_csv
from deltact_fab.shapes import SkinDimensions
from deltact_fab.shapes.indenter import parse

SKIN = SkinDimensions()
SPHERE = parse("sphere:15")
COARSE = 2.5
TRUTH = 0.73


def truth(friction: float = 0.0, spacing: float = COARSE) -> ForceCurve:
    material = GelMaterial(TRUTH, 0.49, friction)
    return force_curve(SKIN, material, SPHERE, (0.0, 0.0), 4.5, spacing_mm=spacing)


def pressed(depth_mm: np.ndarray, normal_n: np.ndarray) -> MeasuredIndentation:
    n = len(depth_mm)
    return MeasuredIndentation(
        "press.csv", depth_mm, normal_n, np.zeros((n, 2)), np.full((n, 2), np.nan)
    )


def fitted(data: MeasuredIndentation, **options: object) -> GelFit:
    given = {"friction": 0.0, "spacing_mm": COARSE, "mesh_error": False, **options}
    return fit_press(data, SKIN, SPHERE, **given)  # type: ignore[arg-type]


def test_exact_without_noise() -> None:
    d = np.linspace(0.0, 3.0, 40)
    found = fitted(pressed(d, truth().normal_n(d)))
    assert found.modulus_mpa.value == pytest.approx(TRUTH, rel=1e-9)
    assert found.rms_rel < 1e-9
    assert found.trend_rel < 1e-9
    assert found.modulus_mpa.high - found.modulus_mpa.low < 1e-8


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_twice_and_half_the_modulus(factor: float) -> None:
    d = np.linspace(0.0, 3.0, 40)
    found = fitted(pressed(d, truth().normal_n(d) * factor))
    assert found.modulus_mpa.value == pytest.approx(TRUTH * factor, rel=1e-9)


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """95 % of 200 draws, both values; by chance less than 180 comes once in 860 such tests."""
    d = np.linspace(-0.2, 3.0, 40)
    clean, rng = truth().normal_n(d), np.random.default_rng(6)
    modulus = offset = 0
    for _ in range(200):
        noisy = clean + rng.normal(0.0, 0.05, len(d))
        found = fitted(pressed(d + 0.3, noisy), fit_offset=True)
        assert found.offset_mm is not None
        modulus += found.modulus_mpa.low <= TRUTH <= found.modulus_mpa.high
        offset += found.offset_mm.low <= 0.3 <= found.offset_mm.high
    assert 180 <= modulus < 200
    assert 180 <= offset < 200


@pytest.mark.parametrize("touch", [-2.0, 0.0, 0.45, 17.0])
def test_first_touch_is_found_wherever_the_stage_counts_from(touch: float) -> None:
    d = np.linspace(-0.5, 3.0, 60)
    found = fitted(pressed(d + touch, truth().normal_n(d)), fit_offset=True)
    assert found.offset_mm is not None
    assert found.offset_mm.value == pytest.approx(touch, abs=1e-5)
    assert found.modulus_mpa.value == pytest.approx(TRUTH, rel=1e-5)


@pytest.mark.slow
def test_a_finer_meshs_data_are_met_within_the_told_mesh_error() -> None:
    d = np.linspace(0.0, 3.0, 60)
    n = truth(spacing=1.8).normal_n(d) + np.random.default_rng(2).normal(0, 0.02, len(d))
    found = fitted(pressed(d, n), mesh_error=True)
    assert found.mesh_error_rel is not None
    assert 0 < found.mesh_error_rel < 0.1
    alone = fitted(pressed(d, n)).modulus_mpa
    more = found.mesh_error_rel * alone.value
    assert found.modulus_mpa.low == pytest.approx(alone.low - more, rel=1e-9)
    assert found.modulus_mpa.high == pytest.approx(alone.high + more, rel=1e-9)
    # Of the noise alone it would not hold it.
    assert not alone.low < TRUTH < alone.high
    assert found.modulus_mpa.low < TRUTH < found.modulus_mpa.high


def test_an_outlier_is_left_out_and_told() -> None:
    d = np.linspace(0.0, 3.0, 50)
    n = truth().normal_n(d) + np.random.default_rng(3).normal(0, 0.02, len(d))
    n[20] += 5.0
    found = fitted(pressed(d, n))
    assert not found.used[20]
    assert found.used.sum() == 49
    assert found.modulus_mpa.value == pytest.approx(TRUTH, rel=0.01)
    assert any("1 of 50 values left out" in note for note in found.notes)


@pytest.mark.slow
def test_a_wrong_thickness_leaves_a_trend_that_is_told() -> None:
    d = np.linspace(0.0, 3.5, 60)
    thin = SkinDimensions(thickness_mm=7.0, protrusion_mm=4.0)
    n = force_curve(
        thin, GelMaterial(TRUTH, 0.49, 0.0), SPHERE, (0.0, 0.0), 3.5, spacing_mm=COARSE
    ).normal_n(d)
    noise = np.random.default_rng(4).normal(0, 0.02, len(d))
    right = fitted(pressed(d, truth().normal_n(d) + noise))
    wrong = fitted(pressed(d, n + noise))
    assert not any("thickness" in note for note in right.notes)
    assert any("thickness" in note for note in wrong.notes)
    assert any("follow each other" in note for note in wrong.notes)


@pytest.mark.slow
def test_a_press_alone_does_not_determine_friction() -> None:
    d = np.linspace(0.0, 1.0, 30)
    n = truth(0.5).normal_n(d) + np.random.default_rng(5).normal(0, 0.05, len(d))
    found = fitted(pressed(d, n), friction=None, fit_friction=True)
    assert found.friction is None
    assert found.as_dict()["friction"] is None
    assert found.friction_used == 0.5
    assert any("friction is not determined" in note for note in found.notes)
    assert found.modulus_mpa.low < TRUTH < found.modulus_mpa.high


def test_an_untared_sensor_is_told() -> None:
    d = np.linspace(-1.0, 3.0, 60)
    n = truth().normal_n(d) + 0.4 + np.random.default_rng(7).normal(0, 0.02, len(d))
    assert any("tare" in note for note in fitted(pressed(d, n)).notes)


@pytest.mark.slow
def test_a_drag_determines_friction() -> None:
    """Made at another friction than any that the fit solves, .6, and with noise."""
    material, rng = GelMaterial(TRUTH, 0.49, 0.6), np.random.default_rng(8)
    d, s = np.linspace(0.0, 2.0, 30), np.linspace(0.2, 4.0, 20)
    tips = np.array([[0, 0, 0.0], [0, 0, 2.0], *[[x, 0, 2.0] for x in s]])
    drag = force_path(SKIN, material, SPHERE, tips, spacing_mm=COARSE, step_mm=0.25)[2:]
    normal = np.concatenate([truth(0.6).normal_n(d), -drag[:, 2]])
    side = np.concatenate([np.zeros((30, 2)), drag[:, :2]])
    data = MeasuredIndentation(
        "drag.csv",
        np.concatenate([d, np.full(20, 2.0)]),
        normal + rng.normal(0, 0.02, 50),
        np.column_stack([np.concatenate([np.zeros(30), s]), np.zeros(50)]),
        side + rng.normal(0, 0.02, (50, 2)),
    )
    found = fitted(data, friction=None)
    assert found.friction is not None
    assert found.friction.value == pytest.approx(0.6, rel=0.03)
    assert found.modulus_mpa.value == pytest.approx(TRUTH, rel=0.02)


HEAD = "depth_mm,normal_n\n"
ROWS = "".join(f"{k / 4},{k**1.5 / 8}\n" for k in range(9))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty; a header with depth_mm, normal_n"),
        ("depth,normal_n\n" + ROWS, r":1: no column depth_mm; found depth, normal_n"),
        ("depth_mm,normal_n,normal_n\n" + ROWS, r":1: column normal_n occurs twice"),
        (HEAD + ROWS + "2.5,oops\n", r":11: column normal_n: 'oops' is not a number"),
        (HEAD + ROWS + "nan,3\n", r":11: column depth_mm: 'nan' is not a number"),
        (HEAD + "# a remark\n\n" + ROWS + "2.5\n", r":13: 1 values below 2 columns"),
        (HEAD + "0,0\n1,2\n", "2 rows; at least 6"),
        (HEAD + ROWS.replace(",", ",-"), "positive = pressed is needed"),
        (HEAD + "".join(f"{-k / 4},{k}\n" for k in range(9)), "force does not grow with depth"),
    ],
)
def test_bad_files_are_refused_by_place(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=said) as why:
        read_csv(path)
    assert str(path) in str(why.value)
    assert "\n" not in str(why.value)


def test_a_missing_or_binary_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_csv(tmp_path / "none.csv")
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputError, match="not UTF-8"):
        read_csv(tmp_path / "b.csv")


def test_comments_spaces_a_byte_order_mark_and_more_columns(tmp_path: Path) -> None:
    path = tmp_path / "good.csv"
    rows = "".join(f"{k}, {k / 4} , {k}, x\n" for k in range(8))
    path.write_text("\ufeff# bench 2\ntime_s, depth_mm , normal_n, operator\n" + rows)
    data = read_csv(path)
    np.testing.assert_array_equal(data.depth_mm, np.arange(8) / 4)
    assert not data.has_tangential


def test_depths_beyond_the_gel_are_refused() -> None:
    d = np.linspace(0.0, 12.0, 30)
    with pytest.raises(InputError, match=r"press\.csv: column depth_mm: a press of 12 mm"):
        fitted(pressed(d, d**1.5))


@pytest.mark.parametrize("touch", [0.0, 5.0])
def test_depths_without_spread_are_refused(touch: float) -> None:
    d = touch + 2.0 + np.linspace(-0.05, 0.05, 30)
    with pytest.raises(InputError, match=r"press\.csv: column depth_mm: all rows are .* spread"):
        fitted(pressed(d, np.full(30, 8.0)), fit_offset=touch > 0)


def test_an_interval_that_holds_0_is_no_modulus() -> None:
    d = np.linspace(0.0, 3.0, 12)
    n = truth().normal_n(d) * 0.02 + np.random.default_rng(11).normal(0, 5.0, 12)
    with pytest.raises(RunFailed, match=r"an interval of -.* which holds 0"):
        fitted(pressed(d, n))


@pytest.mark.parametrize(("factor", "told"), [(1000.0, True), (1e-3, True), (5.0, False)])
def test_forces_in_other_units_are_told(factor: float, told: bool) -> None:
    d = np.linspace(0.0, 3.0, 30)
    notes = fitted(pressed(d, factor * truth().normal_n(d))).notes
    assert any("outside 0.01 to 10 MPa" in note and "mN" in note for note in notes) == told


def test_no_modulus_above_zero() -> None:
    d = np.linspace(0.0, 3.0, 30)
    with pytest.raises(RunFailed, match="no modulus above 0"):
        fitted(pressed(d, -(d**1.5)))


@pytest.mark.slow
def test_the_command(tmp_path: Path) -> None:
    d = np.linspace(0.0, 3.0, 30)
    n = truth().normal_n(d) + np.random.default_rng(9).normal(0, 0.02, len(d))
    path, picture = tmp_path / "press.csv", tmp_path / "fit.png"
    path.write_text(HEAD + "".join(f"{a},{b}\n" for a, b in zip(d + 0.1, n, strict=True)))
    options = ["--indenter", "sphere:15", "--friction", "0", "--spacing", str(COARSE)]
    options += ["--offset", "fit"]
    done = CliRunner().invoke(
        command, [str(path), *options, "--json", "--plot", str(picture)], catch_exceptions=False
    )
    result = json.loads(done.stdout)
    assert set(result) >= {
        "modulus_mpa", "friction", "offset_mm", "rms_n", "points", "model", "notes",
    }  # fmt: skip
    assert result["modulus_mpa"]["low"] < TRUTH < result["modulus_mpa"]["high"]
    assert result["offset_mm"]["value"] == pytest.approx(0.1, abs=0.02)
    assert result["friction"] is None
    assert picture.read_bytes().startswith(b"\x89PNG")
    shown = CliRunner().invoke(command, [str(path), *options], catch_exceptions=False)
    assert f"[specimen]\nmodulus_mpa = {result['modulus_mpa']['value']:.4g}" in shown.stdout


def test_the_commands_refusals(tmp_path: Path) -> None:
    path = tmp_path / "press.csv"
    path.write_text(HEAD + ROWS)
    for options, said in [
        (["--friction", "slick"], "a number or fit is needed"),
        (["--offset", "x"], "a number of mm or fit"),
        (["--at", "1"], "two numbers in mm"),
    ]:
        bad = CliRunner().invoke(command, [str(path), "--indenter", "sphere:15", *options])
        assert bad.exit_code == 2
        assert said in bad.output
