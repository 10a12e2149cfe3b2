"""Sheets: places, sizes, orientation, scale, refusals."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from deltact_fab.common import validate
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.patterns.cell_grid import CellGrid
from deltact_fab.fabricate.patterns.raster import raster
from deltact_fab.fabricate.patterns.recipe import PatternRecipe, choose_recipe, load_recipe
from deltact_fab.fabricate.patterns.sheet import job as sheet
from deltact_fab.fabricate.patterns.sheet import layout
from deltact_fab.fabricate.patterns.sheet.layout import Sheet, width_mm
from deltact_fab.fabricate.pdf import width_em

PLAIN = choose_recipe(None, 0.2, 0.3, size_mm=6.0)
MARKED = validate(
    PatternRecipe,
    {
        **PLAIN.model_dump(exclude_none=True),
        "dots": {
            "columns": 3,
            "rows": 2,
            "pitch_x_mm": 1.3,
            "pitch_y_mm": 1.7,
            "diameter_mm": 0.61,
            "colour": "#ff0000",
        },
    },
    "test",
)


def test_recipe_takes_a_sensor_s_size():
    recipe = load_recipe()
    assert recipe.printed_mm == 34.8
    assert recipe.fitted((30.0, 28.0), (36.0, 34.0)) is recipe
    small = recipe.fitted((15.0, 14.0), (24.0, 22.0))
    assert small.printed_mm == 24.0
    wide = recipe.fitted((55.0, 40.0), (60.0, 50.0))
    assert 56.0 <= wide.printed_mm <= 56.4
    # The view counts before the face.
    assert recipe.fitted((33.0, 20.0), (33.5, 22.0)).printed_mm >= 33.0
    dotted = validate(PatternRecipe, {**recipe.model_dump(exclude_none=True), "dots": {}}, "r")
    with pytest.raises(InputError, match="dots: the grid covers"):
        dotted.fitted((15.0, 14.0), (24.0, 22.0))


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="pdftotext is not installed")
def test_sheet_begins_with_the_verdict(tmp_path):
    made = sheet.write_sheet([PLAIN], tmp_path / "s.pdf", verdict="mine: 1/1 checks passed.")
    said = subprocess.run(["pdftotext", made.out, "-"], capture_output=True, text=True, check=True)
    assert said.stdout.startswith("mine: 1/1 checks passed.")


def picture(recipe, dpi, mirrored=False, scale=(1.0, 1.0)):
    return CellGrid(
        key="",
        cells=recipe.patches(),
        size_mm=(recipe.printed_mm, recipe.printed_mm),
        pitch_mm=(25.4 / dpi / scale[0], 25.4 / dpi / scale[1]),
        mirrored=mirrored,
        grid=recipe.dots,
    )


def page_image(pdf, dpi):
    """The first page as poppler draws it, (h, w, 3) RGB."""
    if shutil.which("pdftoppm") is None:
        pytest.skip("pdftoppm (poppler-utils) is not installed")
    page = pdf.with_suffix("")
    command = ["pdftoppm", "-r", str(dpi), "-png", "-singlefile", str(pdf), str(page)]
    subprocess.run(command, check=True)
    with Image.open(page.with_suffix(".png")) as image:
        return np.asarray(image.convert("RGB"))


def crop(page, sticker, dpi, scale=(1.0, 1.0)):
    """The sticker's pixels, by the report's place."""
    x, y = (
        round(at * s * dpi / 25.4)
        for at, s in zip((sticker.x_mm, sticker.y_mm), scale, strict=True)
    )
    w, h = (round(sticker.side_mm * s * dpi / 25.4) for s in scale)
    return page[y : y + h, x : x + w]


@pytest.mark.parametrize("recipe", [PLAIN, MARKED])
@pytest.mark.parametrize("dpi", [600, 1439.5])
def test_bands_equal_the_raster(recipe, dpi):
    whole = raster(recipe, dpi)
    assert np.array_equal(np.concatenate(list(picture(recipe, dpi).bands())), whole)
    turned = np.concatenate(list(picture(recipe, dpi, mirrored=True).bands()))
    assert np.array_equal(turned, whole[:, ::-1])


@pytest.mark.parametrize("transfer", ["face-down", "slide"])
def test_camera_sees_designed_recipe(tmp_path, transfer):
    """The film is laid on the gel by a rotation, and the camera looks at it from inside."""
    dpi = 600
    made = sheet.write_sheet([MARKED], tmp_path / "s.pdf", dpi=dpi, transfer=transfer, paper="A5")
    page = page_image(made.out, dpi)
    s = made.stickers[0]
    # On the page u is right, v down and w = u x v away from the reader; the ink is on the
    # reader's side. Face-down the ink looks into the sensor (-z), so w = z; slid, w = -z.
    turn = np.diag([1, 1, 1]) if transfer == "face-down" else np.diag([-1, 1, -1])
    assert np.linalg.det(turn) == pytest.approx(1)  # a film cannot be reflected
    margin_px = round(4.5 * dpi / 25.4)
    x, y = round(s.x_mm * dpi / 25.4) - margin_px, round(s.y_mm * dpi / 25.4) - margin_px
    side = round(s.side_mm * dpi / 25.4) + 2 * margin_px
    around = page[y : y + side, x : x + side]
    u, v = np.meshgrid(np.arange(side), np.arange(side))
    centre = (side - 1) / 2
    xyz = turn @ np.stack([u - centre, v - centre, 0 * u]).reshape(3, -1)
    seen = np.empty_like(around)  # image x = +x, image y = +y
    seen[np.rint(xyz[1] + centre).astype(int), np.rint(xyz[0] + centre).astype(int)] = (
        around.reshape(-1, 3)
    )
    inner = seen[margin_px : side - margin_px, margin_px : side - margin_px]
    assert np.array_equal(inner, raster(MARKED, dpi))
    # The F reads right, at (-x, -y), outside both cut lines: a stem on the left, two bars
    mark = seen[: margin_px - 20, : margin_px - 22, 0] < 128
    rows, columns = (np.flatnonzero(mark.any(axis=axis)) for axis in (1, 0))
    letter = mark[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    h, w = letter.shape
    assert letter[:, : w // 5].all()
    assert letter[: h // 8].all()
    assert not letter[-h // 4 :, w // 3 :].any()
    assert not letter[:, -w // 8 :].all()


def test_scale_stretches_sticker_and_rulers(tmp_path):
    dpi, scale = 300, (1.02, 0.97)
    made = sheet.write_sheet([PLAIN], tmp_path / "s.pdf", dpi=dpi, paper="A4", scale=scale)
    page = page_image(made.out, dpi)
    s = made.stickers[0]
    inner = crop(page, s, dpi, scale)
    assert inner.shape[:2] == (round(6 * 0.97 * dpi / 25.4), round(6 * 1.02 * dpi / 25.4))
    assert (inner != 255).any(axis=2).mean() > 0.99
    for axis, true_mm in ((1, 102.0), (0, 97.0)):
        # The longest straight black line of the page along the axis is the ruler's
        dark = (page.max(axis=2) < 128) if axis else (page.max(axis=2) < 128).T
        # It ends with its last tick's left edge, give or take the tick's width
        assert max(map(longest, dark)) * 25.4 / dpi == pytest.approx(true_mm, abs=0.15)


def longest(line):
    """Length of the longest run of a row."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], line.astype(np.int8), [0]))))
    return int(np.diff(edges)[::2].max(initial=0))


def test_marks_do_not_overlap(tmp_path, monkeypatch):
    """Words, codes, stickers and marks of a crowded page, by their boxes."""
    boxes, dpi = [], 400
    real = Sheet.text_line, Sheet.rectangle, Sheet.picture

    def text_line(on, x_mm, y_mm, text, size_pt=layout.TEXT_PT):
        x, y, high = on.x_px(x_mm), on.y_px(y_mm), size_pt * dpi / 72
        wide = width_mm(text, size_pt) * dpi / 25.4
        boxes.append((x, y - 0.72 * high, x + wide, y, "words"))
        return real[0](on, x_mm, y_mm, text, size_pt)

    def rectangle(on, x, y, wide, high, *ink):
        boxes.append((x, y, x + wide, y + high, "box"))
        return real[1](on, x, y, wide, high, *ink)

    def picture(on, x, y, shown, number):
        boxes.append((x, y, x + shown.width_px, y + shown.height_px, "picture"))
        return real[2](on, x, y, shown, number)

    for mark in (text_line, rectangle, picture):
        monkeypatch.setattr(Sheet, mark.__name__, mark)
    recipes = [PLAIN, MARKED, load_recipe("dense"), choose_recipe(None, 1.0, 0.1, 1.0)]
    assert (
        sheet.write_sheet(recipes, tmp_path / "s.pdf", dpi=dpi, copies=2, transfer="slide").pages
        == 1
    )
    page_px = Sheet((210.0, 297.0), dpi, (1.0, 1.0)).page_px
    for k, a in enumerate(boxes):
        assert a[0] >= 0
        assert a[1] >= 0
        assert a[2] <= page_px[0]
        assert a[3] <= page_px[1]
        for b in boxes[:k]:
            if a[4] == b[4] == "box":
                continue  # a ruler's ticks stand on its line
            assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], (a, b)


def test_equal_sheets_are_equal_bytes(tmp_path):
    first = sheet.write_sheet([MARKED], tmp_path / "s.pdf", dpi=400, paper="A5")
    content = first.out.read_bytes()
    assert sheet.write_sheet([MARKED], first.out, dpi=400, paper="A5").sha256 == first.sha256
    assert first.out.read_bytes() == content
    assert len(content) == first.bytes
    assert list(tmp_path.iterdir()) == [first.out]


D = choose_recipe


@pytest.mark.parametrize(
    ("recipe", "options", "says"),
    [
        (D(None, 0.02, 0.1, 20.0), {}, "larger than a patch (0.02 mm); use 1270"),
        (load_recipe("dots"), {"dpi": 100}, "a quarter of a marker dot"),
        (D(None, 1, 0.1, 300.0), {"dpi": 600}, "do not fit on the paper"),
        (PLAIN, {"scale": (1.2, 1.0)}, "scale x: 1.2 must be 0.9 to 1.1"),
        (PLAIN, {"dpi": math.nan}, "dpi: nan; expected 100 to 9600"),
        (load_recipe("dots"), {"dpi": 9600}, "use at most 7950 dpi"),
        (PLAIN, {"paper": "A44"}, "did you mean 'A4'?"),
        (PLAIN, {"transfer": "facedown"}, "did you mean 'face-down'?"),
        (PLAIN, {"copies": 3000}, "at most 2000"),
        (PLAIN, {"out": "s.png"}, "expected a name that ends in .pdf"),
        (PLAIN, {"out": "no/s.pdf"}, "No such file"),
    ],
)
def test_unprintable_sheet_writes_no_file(tmp_path, recipe, options, says):
    options = dict(options)
    out = tmp_path / options.pop("out", "s.pdf")
    with pytest.raises(InputError, match=re.escape(says)) as why:
        sheet.write_sheet([recipe], out, **options)
    assert "\n" not in str(why.value)
    assert not list(tmp_path.iterdir())


def test_fonts_are_embedded(tmp_path):
    if shutil.which("pdffonts") is None:
        pytest.skip("pdffonts is not installed")
    made = sheet.write_sheet([PLAIN], tmp_path / "s.pdf", dpi=600)
    told = subprocess.run(["pdffonts", made.out], capture_output=True, text=True, check=True)
    fonts = told.stdout.splitlines()[2:]
    assert len(fonts) == 1
    # Columns: name, type, encoding, embedded, subset, unicode.
    assert re.search(r"DeltactSans\s+CID TrueType\s+Identity-H\s+yes yes yes", fonts[0])
    said = subprocess.run(["pdftotext", made.out, "-"], capture_output=True, text=True, check=True)
    assert "Print at 100 % (actual size, no fitting)" in said.stdout


def test_film_size_matches_the_bill(tmp_path):
    """Pieces of film are cut from the sheet as they are, so they must not overlap on it."""
    from deltact_fab.fabricate.cad.design import load_design
    from deltact_fab.fabricate.cad.fabrication import bom

    design = load_design(changes=["skin.width_mm=40"])
    wide_mm, high_mm = design.skin.film_mm()
    assert (wide_mm, high_mm) == (60, 54)
    words = f"{wide_mm:g} x {high_mm:g} mm"
    assert any(words in line.note for line in bom.bom_lines(design))
    made = sheet.write_sheet([PLAIN], tmp_path / "s.pdf", copies=7, dpi=600, sensor=design)
    dot_mm = 25.4 / 600
    for k, a in enumerate(made.stickers):
        for b in made.stickers[:k]:
            if a.page == b.page:
                apart_mm = max(abs(a.x_mm - b.x_mm) - wide_mm, abs(a.y_mm - b.y_mm) - high_mm)
                assert apart_mm >= -dot_mm


@pytest.mark.slow
def test_large_sticker_is_streamed(tmp_path):
    tracemalloc.start()
    sheet.write_sheet([D(None, 0.1, 0.6, 60.0)], tmp_path / "s.pdf", dpi=2400)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 60e6  # the raster alone is 96 MB


def test_text_widths_match_helvetica():
    matplotlib = pytest.importorskip("matplotlib", reason="brings the font metrics compared with")
    file = Path(matplotlib.get_data_path(), "fonts/pdfcorefonts/Helvetica.afm")
    found = dict(re.findall(r"C (\d+) ; WX (\d+)", file.read_text(encoding="latin-1")))
    for code in {*range(32, 127)} - {39, 96}:  # two signs that PostScript draws otherwise
        assert width_em(chr(code)) * 1000 == pytest.approx(int(found[str(code)]), abs=1)
