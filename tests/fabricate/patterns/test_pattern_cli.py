"""`deltact-fab pattern` as it is typed: what is made, and what is refused in one line."""

from __future__ import annotations

import hashlib
import json
import re
import sys

import numpy as np
import pytest
from PIL import Image

from deltact_fab.app.cli.main import entry
from deltact_fab.common import validate
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.patterns.code import encode, patches_hash
from deltact_fab.fabricate.patterns.metadata import read_recipe
from deltact_fab.fabricate.patterns.raster import checked_mm_per_px, make_pattern, raster
from deltact_fab.fabricate.patterns.recipe import PatternRecipe, choose_recipe, load_recipe
from deltact_fab.fabricate.patterns.sheet import job as sheet
from deltact_fab.fabricate.patterns.sheet.layout import Sheet

PLAIN = choose_recipe(None, 0.5, 0.1, size_mm=5.0)


def with_dots(size_mm=35.0, patch_mm=0.5, **grid):
    return validate(
        PatternRecipe,
        {
            "law": "algorithm1",
            "seed": 1,
            "size_mm": size_mm,
            "patch_mm": patch_mm,
            "r": 0.1,
            "channels": 3,
            "dots": {"columns": 3, "rows": 2, "colour": "#000000", **grid},
        },
        "test",
    )


WIDE = with_dots(pitch_x_mm=14.0, pitch_y_mm=14.0, diameter_mm=3.0)
BOARD = PatternRecipe(law="chessboard", seed=0, size_mm=20.0, patch_mm=2.0)


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Type words in an empty folder: (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)

    def typed(*words):
        monkeypatch.setattr(sys, "argv", ["deltact-fab", "pattern", *words])
        with pytest.raises(SystemExit) as done:
            entry()
        said = capsys.readouterr()
        return done.value.code, said.out, said.err

    return typed


def one_line(found, *says):
    code, out, err = found
    assert (code, out) == (2, "")
    assert err.startswith("deltact-fab: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    for text in says:
        assert text in err


@pytest.mark.parametrize(
    ("recipe", "says"), [(WIDE, "reduce columns"), (BOARD, "do not fill the camera's view")]
)
def test_sheet_refuses_dots_outside_view(tmp_path, recipe, says):
    with pytest.raises(InputError, match=says) as why:
        sheet.write_sheet([PLAIN, recipe], tmp_path / "s.pdf", dpi=600)
    assert recipe.law in str(why.value)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match=says):
        make_pattern(recipe, tmp_path / "p.png", 300)


@pytest.mark.parametrize("recipe", [WIDE, BOARD])
def test_code_regenerates_for_any_view(run, tmp_path, recipe):
    code, _, err = run("make", encode(recipe), "--dpi", "300", "-o", "p.png", "--json")
    assert (code, err) == (0, "")
    assert json.loads(run("show", encode(recipe), "--json")[1])["law"] == recipe.law
    assert read_recipe(tmp_path / "p.png") == recipe
    with Image.open(tmp_path / "p.png") as image:
        assert np.array_equal(np.asarray(image), raster(recipe, 300))


def test_default_dpi_of_code_fits(run, tmp_path):
    recipe = with_dots(5.0, pitch_x_mm=1.0, pitch_y_mm=1.0, diameter_mm=0.08)
    code, out, err = run("make", encode(recipe), "-o", "p.png", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["dpi"] == 1270


def test_strange_characters_give_one_line(run):
    # A Kelvin sign, which is a plain k in lower case
    one_line(run("make", "DELTACT1/\u212a:1/1EF08C35F591-24EABE", "-o", "p.png"), "0-9, A-Z")


def test_nested_tables_give_one_line(run):
    body = "DELTACT1/A:A:B:1"
    check = hashlib.sha256(body.lower().encode()).hexdigest()[:6].upper()
    found = run("make", f"{body}/1EF08C35F591-{check}", "-o", "p.png")
    one_line(found, "A is a table within a table")


@pytest.mark.parametrize(
    ("words", "suffix"),
    [(("make", "transparent"), ".png"), (("sheet", "transparent", "--dpi", "150"), ".pdf")],
)
def test_long_file_names(run, tmp_path, words, suffix):
    longest = "n" * (255 - len(suffix)) + suffix
    assert run(*words, "-o", longest)[0] == 0
    assert [p.name for p in tmp_path.iterdir()] == [longest]
    for name in ("n" + longest, "n" * 300 + suffix, "n" * 300 + "/p" + suffix):
        one_line(run(*words, "-o", name), "File name too long")
    assert [p.name for p in tmp_path.iterdir()] == [longest]


def test_failed_table_leaves_picture_unchanged(run, tmp_path):
    (tmp_path / "o.dots.csv").mkdir()
    (tmp_path / "o.png").write_bytes(b"old")
    before = sorted(p.name for p in tmp_path.iterdir())
    found = run("make", "dots", "--dpi", "300", "-o", "o.png")
    one_line(found, "o.dots.csv: cannot be written: Is a directory")
    assert sorted(p.name for p in tmp_path.iterdir()) == before
    assert (tmp_path / "o.png").read_bytes() == b"old"


@pytest.mark.slow
def test_long_table_is_not_embedded(tmp_path):
    recipe = with_dots(columns=130, rows=130, pitch_x_mm=0.2, pitch_y_mm=0.16, diameter_mm=0.12)
    made = make_pattern(recipe, tmp_path / "q.png")
    assert made.dots_csv is not None
    assert made.dots_csv.stat().st_size > 2**20
    assert read_recipe(made.image) == recipe
    with Image.open(made.image) as image:
        assert "dots_csv" not in image.text
        assert image.text["dots_sha256"] == made.dots_sha256


def test_suggested_resolutions_work(tmp_path):
    recipe = with_dots(20.0, 0.3, diameter_mm=0.2)  # a dot's quarter is finer than a patch
    with pytest.raises(InputError, match="larger than a patch") as why:
        raster(recipe, 50)
    least, most = map(int, re.search(r"use (\d+) to (\d+)$", str(why.value)).groups())
    assert (least, most) == (508, 14111)
    assert raster(recipe, least).shape[0] == 396
    with pytest.raises(InputError, match=r"use 508 to 14111$"):
        raster(recipe, least - 1)
    checked_mm_per_px(recipe, most)
    with pytest.raises(InputError, match=r"at most 11000; use 508 to 14111$"):
        checked_mm_per_px(recipe, most + 1)


def test_r_and_hash_are_printed_exactly(run, tmp_path, monkeypatch):
    r, seen = 0.9999999999999999, []
    recipe = choose_recipe(None, 0.5, r, size_mm=5.0)
    real = Sheet.text_line
    monkeypatch.setattr(Sheet, "text_line", lambda on, *of: (seen.append(of[2]), real(on, *of))[1])
    sheet.write_sheet([recipe], tmp_path / "s.pdf", dpi=600)
    label = "\n".join(seen)
    digits = hashlib.sha256(recipe.patches().tobytes()).hexdigest()[:12]
    assert digits == patches_hash(recipe)
    assert f"r {r!r}" in label
    assert f"patches {digits}" in label
    made = json.loads(run("make", encode(recipe), "-o", "p.png", "--json")[1])
    assert (made["r"], made["patches_sha256"]) == (r, digits)


def test_large_picture_without_recipe_is_refused(run, tmp_path, monkeypatch):
    """Sheets are beyond the size from which Pillow warns."""
    Image.new("RGB", (40, 4)).save(tmp_path / "f.png")
    make_pattern(load_recipe("transparent"), tmp_path / "p.png", 25.4)
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    one_line(run("show", "f.png"), "contains no recipe")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 40)
    one_line(run("show", "f.png"), "not a readable image")


def test_make_from_options_with_dots(run, tmp_path):
    line = "-d 0.15 -r 0.1 --size 35 --seed 7 --dots -o out.png --json"
    code, out, err = run("make", *line.split())
    assert (code, err) == (0, "")
    made = json.loads(out)
    assert made["files"] == ["out.png", "out.dots.csv"]
    assert (made["size_mm"], made["n"], made["dpi"], made["seed"]) == (34.95, 233, 1200, 7)
    assert (made["law"], made["d"], made["r"]) == ("algorithm1", 0.15, 0.1)
    content = (tmp_path / "out.png").read_bytes()
    assert made["sha256"] == hashlib.sha256(content).hexdigest()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.dots.csv", "out.png"]


def test_make_and_show_named_recipe(run):
    code, out, _ = run("make", "dense", "-o", "x.png")
    assert code == 0
    told = dict(line.split(maxsplit=1) for line in out.splitlines())
    assert (told["n"], told["d"], told["size_mm"]) == ("466", "0.075", "34.95")
    code, out, _ = run("show", "x.png", "--json")
    assert code == 0
    assert json.loads(out)["patch_mm"] == 0.075
    code, out, _ = run("list")
    assert code == 0
    assert "dense-with-dots" in out


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("-d 0.1 -r 1 -o p.png", "r: 1.0; expected 0 <= r < 1"),
        ("-d 5 -r 0.1 --size 2 -o p.png", "at most the side, 2 mm"),
        ("dense --dpi 5 -o p.png", "use 339 to 7994"),
        ("dense -d 0.1 -o p.png", "not both"),
        ("-o p.png", "give a RECIPE"),
        ("dens -o p.png", "did you mean 'dense'?"),
        ("dense -o no/p.png", "no folder no; create it first"),
        ("dense -o .", "is a folder"),
        ("dense --seed -4 -o p.png", "seed"),
    ],
)
def test_bad_input_exits_2(run, tmp_path, line, said):
    one_line(run("make", *line.split()), said)
    assert list(tmp_path.iterdir()) == []
