"""Prints that a script of Pillow and scipy spoils: each fault is told, and nothing else is."""

from __future__ import annotations

import json
import shutil
import subprocess
import tomllib

import numpy as np
import pytest
import spoiled
from called import called
from PIL import Image

from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.patterns.code import encode
from deltact_fab.fabricate.patterns.raster import raster
from deltact_fab.fabricate.patterns.recipe import PatternRecipe, load_recipe
from deltact_fab.fabricate.patterns.verify import load_printer, verify_print

DPI = 600.0
RECIPE = PatternRecipe(law="algorithm1", seed=3, size_mm=12.0, patch_mm=0.2, r=0.3)


def sheet_of(recipe: PatternRecipe, blank: int = 120) -> np.ndarray:
    print_ = raster(recipe, DPI)
    return np.pad(print_, ((blank, blank), (blank, blank), (0, 0)), constant_values=255)


SHEET = sheet_of(RECIPE)
FAULTS: dict[str, tuple[dict, set[str]]] = {
    "sound": ({}, set()),
    "sound, upside down, another scanner": (
        {"turn_deg": 180.6, "noise": 5.0, "blur_px": 0.8, "seed": 4},
        set(),
    ),
    "turned by 91 degrees": ({"turn_deg": 91.0}, set()),
    "scale": ({"scale": (1.0031, 0.994), "turn_deg": -2.0}, {"scale, x", "scale, y"}),
    "shear": ({"shear": 0.004, "turn_deg": 1.3}, {"shear"}),
    "mirrored": ({"mirrored": True}, {"mirror"}),
    "inks apart": ({"inks_px": ((4.0, 0.0), (0.0, -3.0), (0.0, 0.0))}, {"misregistration of inks"}),
    "magenta nearly empty": ({"fade": (1.0, 0.3, 1.0)}, {"inks"}),
    "clogged": ({"streaks": (slice(230, 252),)}, {"gaps"}),
}


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A sound scan, as PNG and as the JPEG of halved colours that Pillow writes."""
    folder, scan = tmp_path_factory.mktemp("scan"), spoiled.print_of(SHEET)
    return [spoiled.save(scan, folder / f"scan.{kind}", DPI) for kind in ("png", "jpg")]


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_fails_only_its_row(tmp_path, fault):
    how, fails = FAULTS[fault]
    scan = spoiled.save(spoiled.print_of(SHEET, **how), tmp_path / "scan.png", DPI)
    done = verify_print(scan, RECIPE)
    assert {row.name for row in done.rows if row.failed} == fails
    x, y = how.get("scale", (1.0, 1.0))
    assert done.measured.scale == pytest.approx((x, y), abs=1e-3)
    assert done.measured.shear == pytest.approx(how.get("shear", 0.0), abs=1e-3)
    turn = how.get("turn_deg", 0.0)
    assert (done.measured.turned_deg - turn + 180) % 360 - 180 == pytest.approx(0, abs=0.1)


def test_gaps_and_misregistration_are_measured(tmp_path):
    image = spoiled.print_of(SHEET, streaks=(slice(230, 252),))
    done = verify_print(spoiled.save(image, tmp_path / "a.png", DPI), RECIPE)
    there_mm = (241 - 120) * 25.4 / DPI - 6.0
    assert {round(y - there_mm) for _, y in done.measured.gaps_mm} <= {-1, 0, 1}
    assert len({x for x, _ in done.measured.gaps_mm}) > 5
    image = spoiled.print_of(SHEET, inks_px=((3.0, 0.0), (0.0, -3.0), (0.0, 0.0)))
    done = verify_print(spoiled.save(image, tmp_path / "b.png", DPI), RECIPE)
    pitch_um = 25400 / DPI
    exact = np.array([[2, 1], [-1, -2], [-1, 1]]) * pitch_um
    assert np.array(done.measured.ink_um) == pytest.approx(exact, abs=0.15 * pitch_um)


def test_photograph_is_judged_without_scale(tmp_path):
    scan = spoiled.print_of(SHEET)
    photo = spoiled.photograph_of(scan, ((60, 40), (620, 90), (590, 600), (20, 550)))
    done = verify_print(spoiled.save(photo, tmp_path / "photo.jpg"), RECIPE)
    assert done.passed
    assert done.measured.scale is None
    with pytest.raises(InputError, match="no scale: use a flatbed scan with a dpi"):
        done.printer()


def test_halved_jpeg_skips_contrast_rows(sound):
    done = verify_print(sound[1], RECIPE)
    assert done.passed
    assert "contrast and inks" in [row.name for row in done.rows]
    with pytest.raises(InputError, match="scan as PNG or TIFF"):
        done.printer()


def test_scaled_sheet_keeps_its_scale(sound):
    known = verify_print(sound[0], RECIPE, scaled=(1.004, 0.998)).printer()
    assert (known.scale_x, known.scale_y) == pytest.approx((1.004, 0.998), abs=1e-3)


def test_other_recipe_is_not_located(sound):
    (row,) = verify_print(sound[1], RECIPE.model_copy(update={"seed": 4})).rows
    assert row.failed
    assert row.value == "pattern not located"


def greyed(scan: np.ndarray) -> np.ndarray:
    return np.repeat(scan.mean(axis=2, keepdims=True), 3, axis=2)


def saturated(scan: np.ndarray, share: float) -> np.ndarray:
    return greyed(scan) + share * (scan - greyed(scan))


COLOURS = {
    "grey": (greyed, False),
    "a tenth of the saturation": (lambda scan: saturated(scan, 0.1), False),
    "red and blue exchanged": (lambda scan: scan[..., ::-1], False),
    "colours turned": (lambda scan: np.roll(scan, 1, axis=2), False),
    "warm scanner": (lambda scan: scan * (1.0, 0.93, 0.8), True),
    "old lamp": (lambda scan: 20 + scan * (0.85, 0.8, 0.5), True),
    "half the saturation": (lambda scan: saturated(scan, 0.5), True),
    "inks that leak": (lambda scan: scan @ (0.7 * np.eye(3) + 0.1), True),
}


@pytest.mark.parametrize("kind", ["png", pytest.param("jpg", marks=pytest.mark.slow)])
@pytest.mark.parametrize("change", COLOURS)
def test_wrong_colours_fail_their_row(tmp_path, change, kind):
    recolour, right = COLOURS[change]
    scan = recolour(spoiled.print_of(SHEET, noise=0.0).astype(float))
    scan = np.clip(scan + np.random.default_rng(1).normal(0, 4, scan.shape), 0, 255)
    path = spoiled.save(scan.astype(np.uint8), tmp_path / f"scan.{kind}", DPI)
    failed = {row.name for row in verify_print(path, RECIPE).rows if row.failed}
    # Exchanged colours may be another recipe's, and lost ones take contrast with them.
    assert failed <= {"contrast kept"} if right else failed & {"colour", "recipe"}


def test_grey_recipe_has_no_colour_row(tmp_path):
    recipe = RECIPE.model_copy(update={"channels": 1})
    scan = spoiled.save(spoiled.print_of(sheet_of(recipe)), tmp_path / "scan.png", DPI)
    done = verify_print(scan, recipe)
    assert done.passed
    assert "colour" not in {row.name for row in done.rows}


@pytest.mark.parametrize("dpi", [DPI / 4, 4 * DPI])
def test_wrong_dpi_is_one_line(tmp_path, dpi):
    scan = spoiled.save(spoiled.print_of(SHEET), tmp_path / "scan.png", dpi)
    with pytest.raises(InputError, match=r"dpi \d.*: the print would be .*; about 600 fits"):
        verify_print(scan, RECIPE)


def test_missing_dpi_is_named(tmp_path):
    # A small sticker on a large page: without a scale anything might be it.
    page = np.full((3600, 3600, 3), 250, np.uint8)
    page[100 : 100 + len(SHEET), 100 : 100 + len(SHEET)] = spoiled.print_of(SHEET)
    path = spoiled.save(page, tmp_path / "scan.png")
    (row,) = verify_print(path, RECIPE).rows
    assert row.value == "pattern not located: no dpi in the file; give --dpi"


def test_swapped_arguments_are_noticed(tmp_path):
    spoiled.save(spoiled.print_of(SHEET), tmp_path / "scan.png", DPI)
    done = called("pattern", "verify", "recommended", "scan.png", cwd=tmp_path)
    assert done.returncode == 2
    assert "SCAN 'recommended', RECIPE 'scan.png': swapped" in done.stderr


def test_bad_scan_gives_one_line(tmp_path):
    (tmp_path / "a.png").write_text("no image")
    with pytest.raises(InputError, match=r"a\.png: not a readable image"):
        verify_print(tmp_path / "a.png", RECIPE)
    with pytest.raises(InputError, match=r"b\.png: no such file"):
        verify_print(tmp_path / "b.png", RECIPE)
    with pytest.raises(InputError, match="--dpi -3: expected 50 to 9600"):
        verify_print(tmp_path / "a.png", RECIPE, -3.0)
    clear = PatternRecipe(law="transparent", seed=1)
    with pytest.raises(InputError, match="one uniform colour"):
        verify_print(tmp_path / "a.png", clear)
    blank = spoiled.save(np.full((900, 900, 3), 240, np.uint8), tmp_path / "c.png", DPI)
    assert not verify_print(blank, RECIPE).passed


def test_printer_file_sets_sheet_and_quality(tmp_path):
    """On the command line: a print that is too large gives a sheet that is smaller."""
    recipe = RECIPE.model_copy(update={"size_mm": 20.0})
    image = spoiled.print_of(sheet_of(recipe), scale=(1.003, 1.001), blur_px=0.8)
    spoiled.save(image, tmp_path / "scan.png", DPI)
    words = ["pattern", "verify", "scan.png", encode(recipe), "-o", "printer.toml"]
    done = called(*words, cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout.startswith("scan.png: fails: scale, x\n")
    known = load_printer(tmp_path / "printer.toml")
    assert (known.scale_x, known.scale_y) == pytest.approx((1 / 1.003, 1 / 1.001), abs=1e-3)
    # Twice the blur, and the line that the script draws between two pixels.
    blur_um = 2 * np.sqrt(0.64 + 1 / 6) * 25400 / DPI
    assert known.spread_um == pytest.approx(blur_um, rel=0.2)
    sheet = ["pattern", "sheet", "dense", "--printer", "printer.toml", "-o", "s.pdf", "--json"]
    made = json.loads(called(*sheet, cwd=tmp_path).stdout)
    assert made["scale"] == [known.scale_x, known.scale_y]
    told = called("pattern", "quality", "dense", "--printer", "printer.toml", cwd=tmp_path).stdout
    assert "values of the camera are assumed" in told
    assert tomllib.loads((tmp_path / "printer.toml").read_text())["spread_um"] == known.spread_um


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("spread_um = -5", "p.toml: spread_um: .* 0 <= spread_um <= 2000"),
        ("scale_z = 1", "p.toml: scale_z: unknown key; did you mean 'scale_y'?"),
    ],
)
def test_bad_printer_file_gives_one_line(tmp_path, text, says):
    (tmp_path / "p.toml").write_text(text)
    with pytest.raises(InputError, match=says):
        load_printer(tmp_path / "p.toml")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("pdftoppm") is None, reason="pdftoppm is not installed")
@pytest.mark.parametrize(
    "name", ["dense-with-dots", pytest.param("octave", marks=pytest.mark.evidence)]
)
def test_sheet_rendered_by_another_program(tmp_path, name):
    called("pattern", "sheet", name, "-o", "sheet.pdf", cwd=tmp_path)
    part = ["-x", "700", "-y", "2000", "-W", "2800", "-H", "2800"]
    command = ["pdftoppm", "-r", "1200", *part, "-png", "-singlefile", "sheet.pdf", "page"]
    subprocess.run(command, cwd=tmp_path, check=True)
    with Image.open(tmp_path / "page.png") as page:
        image = np.asarray(page.convert("RGB"))
    scan = spoiled.print_of(image, scale=(1.004, 0.997), turn_deg=0.7)
    path = spoiled.save(scan, tmp_path / "scan.png", 1200)
    done = verify_print(path, load_recipe(name))
    assert {row.name for row in done.rows if row.failed} == {"scale, x", "scale, y"}
    assert done.measured.scale == pytest.approx((1.004, 0.997), abs=1e-3)
    other = load_recipe(name).model_copy(update={"seed": 99})
    (row,) = verify_print(path, other).rows
    assert row.failed
