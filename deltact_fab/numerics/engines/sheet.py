"""The sheet writer: how far the file's patch edges are from their places, and at what cost.

Edges are read back from the finished PDF: the matrix says where the picture lies, and its pixels,
unpacked, where the colours change. Nothing of the writer's own report is used.
"""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, RunFailed
from ...patterns.code import decode, encode
from ...patterns.laws.patches import draw_patches
from ...patterns.raster import raster
from ...patterns.recipe import PatternRecipe, recipe_from_options
from ...patterns.sheet import job as sheet
from ...patterns.sheet.pixels import unfiltered
from ...units import MM_PER_INCH
from ..engine import Case, CurveSetting, Engine, EngineTable, Work

MM_PER_POINT = MM_PER_INCH / 72
NUMBER_MM = 1e-6 * MM_PER_POINT
"""The file's numbers are written to a millionth of a point."""

EMBEDDINGS: tuple[tuple[str, sheet.Embedding], ...] = (
    ("a pixel a patch", "patches"),
    ("a pixel a printer dot", "dots"),
)


@dataclass(frozen=True, eq=False)
class Read:
    """The sticker as the file has it: place and size (x, y) in mm from the top left, and pixels."""

    at_mm: tuple[float, float]
    size_mm: tuple[float, float]
    pixels: NDArray[np.uint8]


def read_back(path: Path) -> Read:
    """The first colour picture of a PDF of `sheet`. Raises RunFailed when there is none."""
    data = path.read_bytes()
    streams = {
        int(m[1]): (m[2], data[m.end() : m.end() + int(m[3])])
        for m in re.finditer(rb"(\d+) 0 obj\n(<< .*?/Length (\d+) >>)\nstream\n", data)
    }
    box = re.search(rb"/MediaBox \[0 0 ([0-9.]+) ([0-9.]+)\]", data)
    if box is None:
        raise RunFailed(f"{path}: no page")
    for head, content in streams.values():
        if b"/Image" in head:
            continue
        for matrix, name in re.findall(rb"q ([-0-9. ]+) cm /I(\d+) Do", zlib.decompress(content)):
            opening, packed = streams[int(name)]
            if b"/DeviceRGB" in opening:
                wide, _, _, high, left, low = (float(v) * MM_PER_POINT for v in matrix.split())
                found = re.search(rb"/Width (\d+)", opening)
                assert found is not None
                pixels = unfiltered(zlib.decompress(packed), int(found[1]), 3)
                top_mm = float(box[2]) * MM_PER_POINT - low - high
                return Read((left, top_mm), (wide, high), pixels)
    raise RunFailed(f"{path}: no colour picture")


def edge_error_mm(recipe: PatternRecipe, found: Read) -> float:
    """Worst patch edge of a file against k d about the picture's centre; inf when one is missing.

    Needs a pattern whose every row and column differs somewhere from the one before.
    """
    worst_mm = 0.0
    true_mm = (np.arange(1, recipe.n) - recipe.n / 2) * (recipe.printed_mm / recipe.n)
    for axis in (0, 1):
        other = tuple(k for k in range(3) if k != axis)
        changes = np.flatnonzero(
            (np.diff(found.pixels.astype(np.int16), axis=axis)).any(axis=other)
        )
        if len(changes) != recipe.n - 1:
            return math.inf
        count = found.pixels.shape[axis]
        size_mm = found.size_mm[1 - axis]
        edges_mm = ((changes + 1) / count - 0.5) * size_mm
        worst_mm = max(worst_mm, float(np.abs(edges_mm - true_mm).max(initial=0.0)))
    return worst_mm


def _recipe(d_mm: float, r: float, size_mm: float = 35.0) -> PatternRecipe:
    return recipe_from_options(None, d_mm, r, size_mm)


def _written(d_mm: float, dpi: float, embed: sheet.Embedding, scratch: Path) -> Work:
    recipe = _recipe(d_mm, 0.6)
    out = scratch / f"sheet-{d_mm:g}-{dpi:g}-{embed}.pdf"

    def run() -> sheet.SheetReport:
        return sheet.write([recipe], out, dpi=dpi, embed=embed)

    return Work(run, lambda report: edge_error_mm(recipe, read_back(report.out)))


def curves(quick: bool) -> Sequence[CurveSetting]:
    """Both ways of embedding over the printer's resolution."""
    return [
        CurveSetting(
            case=f"35 mm sticker of d = {d_mm:g} mm on A4, PDF",
            series=series,
            name=f"{dpi} dpi",
            unit="mm, worst edge in the file",
            reference="k d, exactly",
            reference_error=NUMBER_MM,
            build=partial(_written, d_mm, dpi, embed),
        )
        for d_mm in ((0.15,) if quick else (0.05, 0.15))
        for series, embed in EMBEDDINGS
        for dpi in ((1200,) if quick else (600, 1200, 2400, 4800))
    ]


def _wrong_pixels(
    d_mm: float, r: float, size_mm: float, dpi: float, scratch: Path
) -> tuple[float, str]:
    """Pixels of the file that differ from the recipe's own raster or patches."""
    recipe = _recipe(d_mm, r, size_mm)
    made = sheet.write([recipe], scratch / "case.pdf", dpi=dpi)
    found = read_back(made.out).pixels
    sticker = made.stickers[0]
    want = draw_patches(recipe) if sticker.embedding == "patches" else raster(recipe, dpi)
    if found.shape != want.shape:
        raise RunFailed(f"{found.shape} pixels in the file, {want.shape} were drawn")
    return int((found != want).any(axis=2).sum()), f"{len(found)} x {len(found)} pixels"


def _size_error(d_mm: float, dpi: float, scratch: Path) -> float:
    """Worst side and corner in the page's matrix, against the sticker's or the raster's own, mm."""
    recipe = _recipe(d_mm, 0.3)
    made = sheet.write([recipe], scratch / "case.pdf", dpi=dpi)
    sticker, found = made.stickers[0], read_back(made.out)
    whole = len(found.pixels) * MM_PER_INCH / dpi
    want_mm = recipe.printed_mm if sticker.embedding == "patches" else whole
    places = (sticker.x_mm, sticker.y_mm)
    return max(
        *(abs(size_mm - want_mm) for size_mm in found.size_mm),
        *(abs(at - said) for at, said in zip(found.at_mm, places, strict=True)),
    )


def _refused(scratch: Path, d_mm: float = 0.2, size_mm: float = 20.0, **options: Any) -> float:
    out = scratch / options.pop("name", "case.pdf")
    return float(sheet.write([_recipe(d_mm, 0.1, size_mm)], out, **options).bytes)


def _largest(dpi: float, scratch: Path) -> tuple[float, str]:
    recipe = _recipe(0.05, 0.6, 100.0)
    start_s = time.process_time()
    made = sheet.write([recipe], scratch / "largest.pdf", dpi=dpi)
    used_s = time.process_time() - start_s
    return used_s, f"{recipe.n} x {recipe.n} patches, {made.bytes / 1e6:.1f} MB"


def _rasterised(d_mm: float, dpi: int, scratch: Path) -> tuple[float, str]:
    """Patch centres of other colour after poppler has drawn the page at the sheet's dpi."""
    import cv2

    recipe = _recipe(d_mm, 0.3, 12.0)
    made = sheet.write([recipe], scratch / "case.pdf", dpi=dpi, paper="A5")
    sticker = made.stickers[0]
    corner = [round(v * dpi / MM_PER_INCH) for v in (sticker.x_mm, sticker.y_mm)]
    side = math.ceil(sticker.side_mm * dpi / MM_PER_INCH)
    window = ["-x", corner[0], "-y", corner[1], "-W", side, "-H", side]
    command = ["pdftoppm", "-r", dpi, *window, "-singlefile", made.out, scratch / "case"]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    image = cv2.imread(str(scratch / "case.ppm"))
    if done.returncode or image is None:
        raise RunFailed(f"pdftoppm: {done.stderr.strip() or 'wrote nothing'}")
    at = np.floor((np.arange(recipe.n) + 0.5) * d_mm * dpi / MM_PER_INCH).astype(int)
    wrong = (image[np.ix_(at, at)][..., ::-1] != draw_patches(recipe)).any(axis=2)
    return int(wrong.sum()), f"of {wrong.size}, {sticker.embedding}"


def _undetected(scratch: Path) -> tuple[float, str]:
    """Damages of one character of a code that are read as a recipe."""
    text = encode(_recipe(0.5, 0.1, 5.0))
    tried = passed = 0
    for k, old in enumerate(text):
        for new in "0123456789ABCDEF-:/.":
            if new == old:
                continue
            tried += 1
            try:
                decode(text[:k] + new + text[k + 1 :])
                passed += 1
            except InputError:
                continue
    return passed, f"of {tried} damages"


def cases(quick: bool) -> Sequence[Case]:
    """Ends of r, d, size and resolution; what must be refused; poppler, where it is installed."""
    side_mm = 10.0 if quick else 35.0
    out = [
        Case(f"r = {r!r}, d = {d_mm:g} mm, {side_mm:g} mm at 1200 dpi", "right",
             partial(_wrong_pixels, d_mm, r, side_mm, 1200), 0, "wrong pixels")
        for r in (0.0, 0.25, 0.2500001, 0.9, 0.9999) for d_mm in (0.075, 0.15)
    ]  # fmt: skip
    out += [
        Case("1 x 1 patch of 35 mm", "right", partial(_wrong_pixels, 35.0, 0.1, 35.0, 1200), 0,
             "wrong pixels"),
        Case("1 x 1 patch of 1 mm", "right", partial(_wrong_pixels, 1.0, 0.1, 1.0, 1200), 0,
             "wrong pixels"),
        Case("d of just one printer dot", "right",
             partial(_wrong_pixels, MM_PER_INCH / 1200, 0.1, 10.0, 1200), 0, "wrong pixels"),
        Case("100 dpi", "right", partial(_wrong_pixels, 1.0, 0.1, 35.0, 100), 0, "wrong pixels"),
        Case("9600 dpi", "right", partial(_wrong_pixels, 0.2, 0.1, side_mm, 9600), 0,
             "wrong pixels"),
        Case("a damaged code is taken for a recipe", "right", _undetected, 0, "codes"),
    ]  # fmt: skip
    out += [
        Case(f"place and size in the page's matrix, d = {d_mm:g} mm, {dpi} dpi", "right",
             partial(_size_error, d_mm, dpi), 1e-3, "mm")
        for d_mm in (0.075, 0.2) for dpi in (1200, 2400)
    ]  # fmt: skip
    out += [
        Case("d below one printer dot", "refused", partial(_refused, d_mm=0.02),
             says="use 1270 dpi or more"),
        Case("d larger than the sticker", "refused", partial(_refused, d_mm=25.0),
             says="at most the side"),
        Case("sticker larger than the paper", "refused", partial(_refused, d_mm=1.0, size_mm=300.0),
             says="do not fit on the paper"),
        Case("scale 1.2", "refused", partial(_refused, scale=(1.2, 1.0)), says="0.9 to 1.1"),
        Case("0 dpi", "refused", partial(_refused, dpi=0.0), says="100 to 9600"),
        Case("NaN dpi", "refused", partial(_refused, dpi=math.nan), says="100 to 9600"),
        Case("A4 as PNG at 2400 dpi", "refused", partial(_refused, dpi=2400.0, name="case.png"),
             says="write a .pdf"),
        Case("two pages as PNG", "refused",
             partial(_refused, dpi=200.0, copies=100, name="case.png"), says="write a .pdf"),
    ]  # fmt: skip
    if shutil.which("pdftoppm"):
        out += [
            Case(f"poppler, d = {d_mm:g} mm at {dpi} dpi", "right",
                 partial(_rasterised, d_mm, dpi), 0, "wrong patch centres")
            for dpi in ((1200,) if quick else (1200, 2400))
            for d_mm in ((0.05, 0.2) if quick else (0.05, 0.075, 0.1, 0.12, 0.15, 0.2))
        ]  # fmt: skip
    if not quick:
        out.append(
            Case("100 x 100 mm of d = 0.05 mm on A4, 2400 dpi", "right", partial(_largest, 2400),
                 15.0, "CPU s")
        )  # fmt: skip
    return out


def tables(scratch: Path) -> Sequence[EngineTable]:
    """What the automatic choice writes: size, time and edges."""
    import tempfile

    rows: list[tuple[Any, ...]] = []
    with tempfile.TemporaryDirectory() as folder:
        for d_mm in (0.05, 0.075, 0.1, 0.15, 0.2):
            for dpi in (600, 1200, 2400, 4800):
                start_s = time.process_time()
                made = sheet.write([_recipe(d_mm, 0.6)], Path(folder, "t.pdf"), dpi=dpi)
                used_s = time.process_time() - start_s
                sticker = made.stickers[0]
                assert sticker.dots_per_patch is not None
                rows.append(
                    (d_mm, dpi, round(sticker.dots_per_patch, 2), sticker.embedding,
                     round(used_s, 3), round(made.bytes / 1e6, 3),
                     round(1000 * sticker.edge_error_mm, 2),
                     round(1000 * sticker.print_error_mm, 2))
                )  # fmt: skip
    return (
        EngineTable(
            "One sticker of 35 mm on A4",
            "r = 0.6, embedded as the writer chooses: one pixel a patch from 5 printer dots a "
            "patch on. Edges in print: on the printer's dots, where one pixel a patch leaves "
            "rounding to the printer, at most a dot.",
            ("d mm", "dpi", "dots a patch", "a pixel is one of", "CPU s", "MB",
             "edge in the file um", "edge in print um"),
            tuple(rows),
        ),
    )  # fmt: skip


ENGINE = Engine(
    "sheet",
    "Sheet writer",
    "Stickers as PDF: one pixel a patch at exact millimetres, or one pixel a printer dot.",
    curves,
    cases,
    tables,
)
