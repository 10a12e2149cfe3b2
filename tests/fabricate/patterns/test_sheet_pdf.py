"""The sheet's PDF: its structure by a reader of its own, its pixels by poppler."""

from __future__ import annotations

import itertools
import re
import shutil
import subprocess
import zlib

import cv2
import numpy as np
import pytest

from deltact_fab.common import validate
from deltact_fab.fabricate.patterns.code import decode_recipe
from deltact_fab.fabricate.patterns.recipe import PatternRecipe, choose_recipe, load_recipe
from deltact_fab.fabricate.patterns.sheet import job as sheet
from deltact_fab.fabricate.patterns.sheet.page_marks import INK_PATCHES

needs_poppler = pytest.mark.skipif(
    shutil.which("pdftoppm") is None, reason="pdftoppm (poppler-utils) is not installed"
)
FINE = choose_recipe(None, 0.075, 0.6, size_mm=12.0)
COARSE = choose_recipe(None, 0.2, 0.3, size_mm=12.0)


def objects(data):
    """Body of every object, by number, found through the cross-reference table."""
    start = int(re.search(rb"startxref\n(\d+)\n%%EOF\n$", data)[1])
    entries = re.findall(rb"(\d{10}) \d{5} n \n", data[start:])
    offsets = [int(e) for e in entries] + [start]
    found = {}
    for number, (at, end) in enumerate(itertools.pairwise(offsets), 1):
        head = b"%d 0 obj\n" % number
        assert data[at:end].startswith(head)
        found[number] = data[at + len(head) : end].removesuffix(b"\nendobj\n")
    return found


def stream(body):
    """Dictionary and inflated content of a stream object."""
    head, _, rest = body.partition(b" >>\nstream\n")
    length = int(re.search(rb"/Length (\d+)", head)[1])
    assert rest[length:] == b"\nendstream"
    return head.decode(), zlib.decompress(rest[:length])


def placed_images(data):
    """(page, matrix, width, height, opening) of every image drawn, in order."""
    every = objects(data)
    out = []
    pages = [b for b in every.values() if b"/Type /Page " in b]
    for k, page in enumerate(pages):
        content = stream(every[int(re.search(rb"/Contents (\d+)", page)[1])])[1].decode()
        for matrix, name in re.findall(r"q ([-0-9. ]+) cm /I(\d+) Do Q", content):
            head, raw = stream(every[int(name)])
            width, height = (int(re.search(rf"/{k} (\d+)", head)[1]) for k in ("Width", "Height"))
            colours = 3 if "DeviceRGB" in head else 1
            assert len(raw) == height * width * colours
            out.append((k, [float(v) for v in matrix.split()], width, height, head))
    return out


def media_mm(data):
    box = re.search(rb"/MediaBox \[0 0 ([0-9.]+) ([0-9.]+)\]", data)
    return [float(v) * 25.4 / 72 for v in box.groups()]


def rendered(pdf, dpi, sticker=None, pad=0, scale=(1.0, 1.0)):
    """The page, or a sticker with `pad` dots around it, by poppler: (h, w, 3) RGB."""
    window = []
    if sticker is not None:
        x, y = (
            round(at * s * dpi / 25.4)
            for at, s in zip((sticker.x_mm, sticker.y_mm), scale, strict=True)
        )
        side = int(np.ceil(sticker.side_mm * max(scale) * dpi / 25.4)) + 2 * pad
        window = ["-x", x - pad, "-y", y - pad, "-W", side, "-H", side]
    root = pdf.with_suffix("")
    page = ["-f", sticker.page, "-l", sticker.page] if sticker is not None else ["-l", 1]
    command = ["pdftoppm", "-r", dpi, *page, *window, "-singlefile", pdf, root]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    image = cv2.imread(str(root.with_suffix(".ppm")))
    assert image is not None
    return image[..., ::-1]


@pytest.mark.parametrize(("dpi", "transfer"), [(1200, "slide"), (2400, "face-down")])
def test_matrix_is_exact_to_a_micrometre(tmp_path, dpi, transfer):
    made = sheet.write_sheet(
        [FINE, COARSE], tmp_path / "s.pdf", dpi=dpi, transfer=transfer, copies=2
    )
    data = made.out.read_bytes()
    assert data.startswith(b"%PDF-1.7\n")
    assert b"/PrintScaling /None" in objects(data)[1]
    assert b"Date" not in b"".join(b for b in objects(data).values() if b"stream" not in b)
    high_mm = media_mm(data)[1]
    found = [i for i in placed_images(data) if "/DeviceRGB" in i[4]]
    assert len(found) == 4
    for s, (_, matrix, width, height, head) in zip(made.stickers, found, strict=True):
        a, b, c, d, e, f = (v * 25.4 / 72 for v in matrix)
        assert b == c == 0
        # A whole number of dots, the nearest to the side
        want_mm = width * 25.4 / dpi
        assert width == height == round(s.side_mm * dpi / 25.4)
        assert s.print_error_mm <= 25.4 / dpi / 2 + 1e-4
        assert a == pytest.approx(want_mm, abs=1e-3)
        assert d == pytest.approx(want_mm, abs=1e-3)
        # The corner lies on the dot grid, counted from the page's top left
        assert e == pytest.approx(s.x_mm, abs=1e-3)
        assert high_mm - f - d == pytest.approx(s.y_mm, abs=1e-3)
        for at_mm in (s.x_mm, s.y_mm):
            assert abs(at_mm * dpi / 25.4 - round(at_mm * dpi / 25.4)) < 1e-3
        assert "/Interpolate false" in head
        assert "/FlateDecode" in head


def test_page_is_whole_dots(tmp_path):
    for paper, size_mm in (("A4", (210, 297)), ("letter", (215.9, 279.4))):
        made = sheet.write_sheet([COARSE], tmp_path / "s.pdf", paper=paper)
        for side_mm, want_mm in zip(media_mm(made.out.read_bytes()), size_mm, strict=True):
            assert side_mm == pytest.approx(want_mm, abs=25.4 / 1200 / 2 + 1e-4)
            assert abs(side_mm * 1200 / 25.4 - round(side_mm * 1200 / 25.4)) < 1e-3


def test_copies_share_one_image(tmp_path):
    once = sheet.write_sheet([FINE], tmp_path / "a.pdf").bytes
    many = sheet.write_sheet([FINE], tmp_path / "b.pdf", copies=20)
    assert many.pages > 1
    assert many.bytes < once + 40_000


CASES = [(0.075, 1200, "slide"), (0.05, 2400, "face-down"), (0.12, 1200, "face-down")]


@needs_poppler
@pytest.mark.parametrize(("d", "dpi", "transfer"), CASES)
def test_every_patch_centre_is_exact(tmp_path, d, dpi, transfer):
    recipe = choose_recipe(None, d, 0.3, size_mm=9.0)
    made = sheet.write_sheet([recipe], tmp_path / "s.pdf", dpi=dpi, transfer=transfer, paper="A5")
    s, pad = made.stickers[0], 6
    image = rendered(made.out, dpi, s, pad)
    want = recipe.patches()
    if transfer == "slide":
        want = want[:, ::-1]
    at = np.floor(pad + (np.arange(recipe.n) + 0.5) * d * dpi / 25.4).astype(int)
    assert np.array_equal(image[np.ix_(at, at)], want)
    inked = (image != 255).any(axis=2)
    for axis in (0, 1):
        line = np.flatnonzero(inked.mean(axis=axis) > 0.8)
        assert line[0] == pad
        assert abs(len(line) - s.side_mm * dpi / 25.4) <= 1
    # Every edge, read off the picture: as far from the true place as the report says
    step = np.abs(np.diff(image[pad:-pad, pad:-pad].astype(int), axis=1)).sum(axis=(0, 2))
    edges_mm = (np.flatnonzero(step) + 1)[: recipe.n - 1] * 25.4 / dpi
    true_mm = np.arange(1, recipe.n) * d
    side_dots = s.side_mm * dpi / 25.4
    # A raster is right about its centre: its corner is off by half of what its side is
    shift_mm = abs(round(side_dots) - side_dots) / 2 * 25.4 / dpi
    worst_mm = np.abs(edges_mm - true_mm).max()
    assert s.print_error_mm / 2 - shift_mm < worst_mm <= s.print_error_mm + shift_mm + 1e-9


@needs_poppler
@pytest.mark.parametrize(("dpi", "transfer"), [(300, "face-down"), (600, "slide")])
def test_codes_are_readable_on_page(tmp_path, dpi, transfer):
    octave = validate(
        PatternRecipe,
        {"law": "octave", "seed": 5, "size_mm": 20.0, "patch_mm": 0.1, "scales_mm": [0.1, 0.4]},
        "test",
    )
    recipes = [choose_recipe(None, 0.1, 0.6), load_recipe("dense-with-dots"), octave]
    made = sheet.write_sheet(recipes, tmp_path / "s.pdf", dpi=dpi, transfer=transfer)
    page = rendered(made.out, dpi)
    for recipe, s in zip(recipes, made.stickers, strict=True):
        # Below the film, left of the label.
        left, top = s.x_mm + s.side_mm / 2 - 28.0, s.y_mm + s.side_mm / 2 + 27.6
        x, y = (round(v * dpi / 25.4) for v in (left, top))
        part = np.ascontiguousarray(page[y : y + dpi * 20 // 25, x : x + dpi * 20 // 25, ::-1])
        text, _, _ = cv2.QRCodeDetector().detectAndDecode(part)
        assert text == s.code
        again = decode_recipe(text)
        assert again == recipe
        assert np.array_equal(again.patches(), recipe.patches())


@needs_poppler
def test_page_has_rulers_and_colours(tmp_path):
    made = sheet.write_sheet([COARSE], tmp_path / "s.pdf", dpi=600, paper="A5")
    page = rendered(made.out, 600)
    seen = {tuple(c) for c in np.unique(page[::9, ::9].reshape(-1, 3), axis=0)}
    for _, ink in INK_PATCHES:
        assert (ink if isinstance(ink, tuple) else (ink,) * 3) in seen
    dark = page.max(axis=2) < 128
    for lines in (dark, dark.T):
        # Ticks of the ruler, just below (right of) its line: 101, a millimetre apart
        runs = [np.flatnonzero(np.diff(np.concatenate(([0], line, [0])))) for line in lines]
        lengths = [int(np.max(np.diff(run)[::2], initial=0)) for run in runs]
        k = int(np.argmax(lengths))
        below = lines[k + round(0.8 * 600 / 25.4)]
        starts = np.flatnonzero(np.diff(below.astype(int)) == 1) + 1
        first = runs[k][::2][int(np.argmax(np.diff(runs[k])[::2]))]
        ticks = starts[(starts >= first) & (starts <= first + 100.5 * 600 / 25.4)]
        assert len(ticks) == 101
        assert np.abs((ticks - first) * 25.4 / 600 - np.arange(101)).max() <= 25.4 / 600


@pytest.mark.parametrize("scale", [(1.0, 1.0), (1.013, 0.991)])
def test_reported_side_is_the_files(tmp_path, scale):
    """Against the page's matrix; a raster is whole printer dots, not n d."""
    recipes = [choose_recipe(None, d, 0.6) for d in (0.05, 0.075, 0.2)]
    made = sheet.write_sheet(recipes, tmp_path / "s.pdf", scale=scale)
    found = [i for i in placed_images(made.out.read_bytes()) if "/DeviceRGB" in i[4]]
    for recipe, s, (_, matrix, *_) in zip(recipes, made.stickers, found, strict=True):
        true_mm = [
            matrix[k] * 25.4 / 72 / stretch for k, stretch in zip((0, 3), scale, strict=True)
        ]
        assert s.file_side_mm == pytest.approx(true_mm, abs=1e-6)
        assert s.side_error_mm == pytest.approx(
            [v - recipe.n * recipe.patch_mm for v in true_mm], abs=1e-6
        )
    if scale == (1.0, 1.0):
        errors_um = [1000 * s.side_error_mm[0] for s in made.stickers]
        assert errors_um == pytest.approx([9.5, -4.0, 9.5], abs=0.05)
        assert made.as_dict()["stickers"][1]["file_side_mm"][1] == pytest.approx(34.94597, abs=1e-5)
