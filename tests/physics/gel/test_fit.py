"""`gel fit`: what is found in synthetic presses, and what is refused or told."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from deltact_fab.app.cli.gel import fit as command
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.physics.gel.fit.fit import GelFit, fit_press
from deltact_fab.physics.gel.fit.force_curve import ForceCurve, force_curve
from deltact_fab.physics.gel.fit.measured import MeasuredIndentation
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SKIN = SkinDimensions()
SPHERE = parse_indenter("sphere:15")
COARSE = 2.5
TRUTH = 0.73


def truth(
    friction: float = 0.0, spacing: float = COARSE, skin: SkinDimensions = SKIN
) -> ForceCurve:
    material = GelMaterial(TRUTH, 0.49, friction)
    return force_curve(skin, material, SPHERE, (0.0, 0.0), 3.5, spacing_mm=spacing)


def pressed(depth_mm: np.ndarray, normal_n: np.ndarray) -> MeasuredIndentation:
    return MeasuredIndentation("press.csv", depth_mm, normal_n)


def fitted(depth_mm: np.ndarray, normal_n: np.ndarray, **options: object) -> GelFit:
    given = {"friction": 0.0, "spacing_mm": COARSE, "mesh_error": False, **options}
    return fit_press(pressed(depth_mm, normal_n), SKIN, SPHERE, **given)  # type: ignore[arg-type]


def noise(seed: int, n: int, size_n: float = 0.02) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, size_n, n)


@pytest.mark.parametrize("factor", [0.5, 1.0])
def test_exact_without_noise(factor: float) -> None:
    d = np.linspace(0.0, 3.0, 40)
    found = fitted(d, truth().normal_n(d) * factor)
    assert found.modulus_mpa.value == pytest.approx(TRUTH * factor, rel=1e-9)
    assert max(found.rms_rel, found.trend_rel) < 1e-9
    assert found.modulus_mpa.high - found.modulus_mpa.low < 1e-8


@pytest.mark.slow
def test_intervals_have_their_coverage() -> None:
    """95 % of 200 draws, both values; by chance less than 180 comes once in 860 such tests."""
    d = np.linspace(-0.2, 3.0, 40)
    clean, rng = truth().normal_n(d), np.random.default_rng(6)
    modulus = offset = 0
    for _ in range(200):
        found = fitted(d + 0.3, clean + rng.normal(0.0, 0.05, len(d)), fit_offset=True)
        assert found.offset_mm is not None
        modulus += found.modulus_mpa.low <= TRUTH <= found.modulus_mpa.high
        offset += found.offset_mm.low <= 0.3 <= found.offset_mm.high
    assert 180 <= modulus < 200
    assert 180 <= offset < 200


@pytest.mark.parametrize("touch", [-2.0, 0.45, 17.0])
def test_first_touch_found_at_any_offset(touch: float) -> None:
    d = np.linspace(-0.5, 3.0, 60)
    found = fitted(d + touch, truth().normal_n(d), fit_offset=True)
    assert found.offset_mm is not None
    assert found.offset_mm.value == pytest.approx(touch, abs=1e-5)
    assert found.modulus_mpa.value == pytest.approx(TRUTH, rel=1e-5)


@pytest.mark.slow
def test_mesh_error_covers_finer_mesh() -> None:
    d = np.linspace(0.0, 3.0, 60)
    n = truth(spacing=1.8).normal_n(d) + noise(2, len(d))
    found = fitted(d, n, mesh_error=True)
    assert found.mesh_error_rel is not None
    assert 0 < found.mesh_error_rel < 0.1
    alone = fitted(d, n).modulus_mpa
    more = found.mesh_error_rel * alone.value
    assert found.modulus_mpa.low == pytest.approx(alone.low - more, rel=1e-9)
    assert found.modulus_mpa.high == pytest.approx(alone.high + more, rel=1e-9)
    # Of the noise alone it would not hold it.
    assert not alone.low < TRUTH < alone.high
    assert found.modulus_mpa.low < TRUTH < found.modulus_mpa.high


@pytest.mark.slow
def test_wrong_thickness_warns_of_a_trend() -> None:
    d = np.linspace(0.0, 3.5, 60)
    thin = SkinDimensions(thickness_mm=7.0, protrusion_mm=4.0)
    right = fitted(d, truth().normal_n(d) + noise(4, len(d)))
    wrong = fitted(d, truth(skin=thin).normal_n(d) + noise(4, len(d)))
    assert not any("thickness" in note for note in right.notes)
    assert any("thickness" in note for note in wrong.notes)
    assert any("are correlated" in note for note in wrong.notes)


def test_suspect_data_get_notes() -> None:
    d = np.linspace(-1.0, 3.0, 60)
    n = truth().normal_n(d) + noise(7, len(d))
    outlier = n.copy()
    outlier[45::2] += 3.0
    found = fitted(d, outlier)
    assert np.flatnonzero(~found.inliers).tolist() == list(range(45, 60, 2))
    rest = fitted(d[found.inliers], outlier[found.inliers])
    assert vars(found.modulus_mpa) == pytest.approx(vars(rest.modulus_mpa), rel=1e-6)
    for values, told in (
        (outlier, "8/60 values not fitted"),
        (n + 0.4, "tare"),
        (1000 * n, "mN"),
        (n / 1000, "mN"),
    ):
        assert any(told in note for note in fitted(d, values).notes), told
    assert fitted(d, n).notes == ()


HEAD = "depth_mm,normal_n\n"
ROWS = "".join(f"{k / 4},{k**1.5 / 8}\n" for k in range(9))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty; expected a header with depth_mm, normal_n"),
        ("depth,normal_n\n" + ROWS, r":1: no column depth_mm; .*got depth, normal_n"),
        ("depth_mm,normal_n,normal_n\n" + ROWS, r":1: column normal_n occurs twice"),
        (HEAD + ROWS + "2.5,oops\n", r":11: column normal_n: 'oops' is not a finite number"),
        (HEAD + ROWS + "nan,3\n", r":11: column depth_mm: 'nan' is not a finite number"),
        (HEAD + "# a remark\n\n" + ROWS + "2.5\n", r":13: 1 values below 2 columns"),
        (HEAD + "0,0\n1,2\n", "2 rows of a straight press; at least 6"),
        (HEAD + ROWS.replace(",", ",-"), "expected positive when pressed"),
        (HEAD + "".join(f"{-k / 4},{k}\n" for k in range(9)), "force does not grow with depth"),
        ("\xff", "not UTF-8"),
    ],
)
def test_bad_files_are_refused_by_place(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=said) as why:
        MeasuredIndentation.from_csv(path)
    assert str(path) in str(why.value)
    assert "\n" not in str(why.value)


def test_csv_with_comments_and_drag(tmp_path: Path) -> None:
    path = tmp_path / "good.csv"
    rows = "".join(f"{k}, {k / 4} , {k}, 0.01, x\n" for k in range(8)) + "8, 2, 7, 0.5, x\n"
    path.write_text("\ufeff# bench 2\ntime_s, depth_mm , normal_n, shear_y_mm, operator\n" + rows)
    data = MeasuredIndentation.from_csv(path)
    np.testing.assert_array_equal(data.depth_mm, np.arange(8) / 4)
    assert data.dragged == 1


@pytest.mark.parametrize(
    ("depth_mm", "offset", "said"),
    [
        (np.linspace(0, 12, 30), False, r"press\.csv: column depth_mm: a press of 12 mm"),
        (
            np.linspace(1.95, 2.05, 30),
            False,
            r"press\.csv: column depth_mm: all rows are .* spread",
        ),
        (np.linspace(6.95, 7.05, 30), True, r"press\.csv: column depth_mm: all rows are .* spread"),
    ],
)
def test_depths_that_tell_nothing_are_refused(
    depth_mm: np.ndarray, offset: bool, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        fitted(depth_mm, depth_mm**1.5, fit_offset=offset)


def test_forces_without_modulus_are_refused() -> None:
    d = np.linspace(0.0, 3.0, 12)
    with pytest.raises(RunFailed, match=r"an interval of -.* includes 0"):
        fitted(d, truth().normal_n(d) * 0.02 + noise(11, 12, 5.0))
    with pytest.raises(RunFailed, match="no modulus above 0"):
        fitted(d, -(d**1.5))


@pytest.mark.slow
def test_command_on_a_run(mini_run: Path) -> None:
    """The press of the ball of a run on the linear gel; an option replaces what the run states."""
    words = [str(mini_run), "--press", "sphere-10/p1", "--spacing", "1", "--json"]
    found, thin = (
        json.loads(CliRunner().invoke(command, [*words, *more], catch_exceptions=False).stdout)
        for more in ([], ["--thickness", "6"])
    )
    assert found["modulus_mpa"]["value"] == pytest.approx(0.56, rel=0.05)
    assert found["at_mm"] == [0.5, -0.5]
    assert (found["thickness_mm"], thin["thickness_mm"]) == (12, 6)
    assert thin["modulus_mpa"]["value"] < 0.95 * found["modulus_mpa"]["value"]
    assert any(note.endswith("along the face on: not fitted") for note in found["notes"])


@pytest.mark.parametrize(
    ("more", "said"), [([], "--indenter: needed"), (["--press", "p1"], "--press: only for a run")]
)
def test_command_on_incomplete_table(tmp_path: Path, more: list[str], said: str) -> None:
    (tmp_path / "press.csv").write_text(HEAD + ROWS)
    done = CliRunner().invoke(command, [str(tmp_path / "press.csv"), *more])
    assert isinstance(done.exception, InputError)
    assert said in str(done.exception)


@pytest.mark.slow
def test_the_command(tmp_path: Path) -> None:
    d = np.linspace(0.0, 3.0, 30)
    n = truth().normal_n(d) + noise(9, len(d))
    path = tmp_path / "press.csv"
    path.write_text(HEAD + "".join(f"{a},{b}\n" for a, b in zip(d + 0.1, n, strict=True)))
    options = ["--indenter", "sphere:15", "--friction", "0", "--spacing", str(COARSE)]
    options += ["--offset", "fit"]
    done = CliRunner().invoke(command, [str(path), *options, "--json"], catch_exceptions=False)
    result = json.loads(done.stdout)
    assert result["modulus_mpa"]["low"] < TRUTH < result["modulus_mpa"]["high"]
    assert result["offset_mm"]["value"] == pytest.approx(0.1, abs=0.02)
    shown = CliRunner().invoke(command, [str(path), *options], catch_exceptions=False)
    assert f"[specimen]\nmodulus_mpa = {result['modulus_mpa']['value']:.4g}" in shown.stdout
    bad = CliRunner().invoke(command, [str(path), "--indenter", "sphere:15", "--offset", "x"])
    assert bad.exit_code == 2
    assert "must be a number in mm, or fit" in bad.output
