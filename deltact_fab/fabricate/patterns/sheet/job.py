"""A print job: stickers on pages to scale, with marks that identify them.

Whether a sticker is printed mirrored depends on which side of the film the ink is on (paper,
Fabrication Process; frames as in `optics`). The camera is inside, looks out along +z, and must see
the recipe as designed, with row 0, column 0 at (-x, -y).

- `face-down`: the printed side lies on the gel. The camera sees the printed side of the ink, as a
  person looking at the sheet does. The sheet shows the array unchanged.
- `slide`: the film slides off its backing onto the gel, film first. The camera looks through gel
  and film at the back of the ink, where left and right are exchanged. The sheet shows the array
  with its columns reversed.

In both cases an F marks the corner (-x, -y) beside the pattern, mirrored with the sticker. It reads
correctly from the side that lies on the gel, where the camera is; otherwise the film is the wrong
way round. Labels and QR codes are never mirrored.

A scale correction stretches everything, the rulers too: a corrected sheet is right when its own
rulers measure 100 mm. Otherwise multiply the correction by 100 / their measured length.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from deltact_fab.common import InputError, Progress, did_you_mean, write_files
from deltact_fab.sensor import SensorDimensions
from deltact_fab.version import PACKAGE_VERSION

from ...pdf import Document
from ..cell_grid import CellGrid
from ..code import encode
from ..raster import check_seen
from ..recipe import PatternRecipe
from . import layout, page_marks
from .layout import INSET_MM, Sheet, StickerCell

Transfer = Literal["face-down", "slide"]

TRANSFER_SIDES = ("face-down", "slide")
# By hand: resolutions of printers; more than 10 % is no scale error; thousands take minutes.
SHEET_DPI_RANGE, SCALE_RANGE, MAX_STICKERS = (100.0, 9600.0), (0.9, 1.1), 2000


@dataclass(frozen=True)
class Sticker:
    """A printed sticker. x_mm, y_mm: its top left corner on the page, on the real print.

    file_side_mm: side of the picture in the file, (x, y) on the real print, in whole printer dots.
    side_error_mm: its difference from side_mm = n d. print_error_mm: largest error of a patch
    edge about the sticker's centre.
    """

    page: int
    x_mm: float
    y_mm: float
    side_mm: float
    file_side_mm: tuple[float, float]
    side_error_mm: tuple[float, float]
    dots_per_patch: float | None
    print_error_mm: float
    patch_mm: float | None
    code: str


@dataclass(frozen=True)
class SheetReport:
    """Result of `write_sheet`; print_error_mm: worst of all stickers."""

    out: Path
    paper: str
    dpi: float
    transfer: str
    scale: tuple[float, float]
    pages: int
    stickers: tuple[Sticker, ...]
    print_error_mm: float
    bytes: int
    sha256: str
    codes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as `pattern sheet --json` prints it."""
        return {**asdict(self), "out": str(self.out)}


def write_sheet(
    recipes: Sequence[PatternRecipe],
    out: Path,
    *,
    paper: str = "A4",
    dpi: float = 1200.0,
    transfer: Transfer = "face-down",
    copies: int = 1,
    scale: tuple[float, float] = (1.0, 1.0),
    sensor: SensorDimensions | None = None,
    verdict: str = "",
    progress: Progress | None = None,
) -> SheetReport:
    """Write the stickers as a PDF, on as many pages as they need.

    verdict: of the design's checks, at the head of each page; empty: none.
    scale: 100 / measured length of the ruler in (x, y), times the scale of that sheet.
    Memory is bounded by the compressed file; equal arguments and versions give equal bytes.

    Raises InputError for anything that cannot be printed as requested or used by the sensor's
    camera (`raster.check_seen`); nothing is written then.
    """
    if out.suffix.lower() != ".pdf":
        raise InputError(f"{out}: expected a name that ends in .pdf")
    paper = next((name for name in layout.PAPERS_MM if name.lower() == paper.lower()), paper)
    sheet = _checked_sheet(paper, dpi, transfer, scale)
    if not recipes:
        raise InputError("a sheet needs at least one recipe")
    if not 1 <= copies <= MAX_STICKERS or len(recipes) * copies > MAX_STICKERS:
        raise InputError(
            f"copies: {copies} of {len(recipes)} recipes; expected at least 1, and at most "
            f"{MAX_STICKERS} stickers in total"
        )
    tell = progress or (lambda *_: None)
    sensor = sensor or SensorDimensions()
    total = len(recipes) + 1
    cells: dict[PatternRecipe, StickerCell] = {}
    for k, recipe in enumerate(recipes):
        tell(k, total, f"sticker {k + 1}")
        if recipe in cells:
            continue
        try:
            check_seen(recipe, sensor.optics.view_mm)
        except InputError as error:
            raise InputError(f"{page_marks.sticker_name(recipe)}: {error}") from error
        cells[recipe] = page_marks.make_cell(
            recipe, encode(recipe), sheet, transfer == "slide", sensor.skin.film_mm()
        )
    tell(len(recipes), total, "file")
    order = [recipe for recipe in recipes for _ in range(copies)]
    names = [page_marks.sticker_name(recipe) for recipe in order]
    head, top_mm = page_marks.header(sheet, paper, transfer, verdict)
    places = layout.place_cells(sheet, [cells[recipe] for recipe in order], names, top_mm)
    pages = places[-1].page + 1
    file, images = Document(), dict[str, int]()
    stickers: list[Sticker] = []
    for page in range(pages):
        marks, page_images = list(head), dict[str, int]()
        for place in (p for p in places if p.page == page):
            recipe = order[place.cell]
            cell = cells[recipe]
            for picture in (cell.sticker, cell.code):
                if picture.key not in images:
                    images[picture.key] = _image(file, picture)
                page_images[f"I{images[picture.key]}"] = images[picture.key]
            on_page, at_px = page_marks.draw_cell(sheet, cell, place.x_mm, place.y_mm, images)
            marks += on_page
            stickers.append(_sticker(page, cell.sticker, at_px, scale, recipe))
        marks += page_marks.footer(sheet, page, pages)
        file.page(sheet.size_pt, "\n".join(marks), page_images)
    codes = tuple(cell.sticker.key for cell in cells.values())
    content = file.finish("Pattern stickers", f"deltact-fab {PACKAGE_VERSION}", codes)
    write_files({out: content})
    tell(total, total, "file")
    return SheetReport(
        out=out,
        paper=paper,
        dpi=dpi,
        transfer=transfer,
        scale=scale,
        pages=pages,
        stickers=tuple(stickers),
        print_error_mm=max(s.print_error_mm for s in stickers),
        bytes=len(content),
        sha256=hashlib.sha256(content).hexdigest(),
        codes=codes,
    )


def _checked_sheet(paper: str, dpi: float, transfer: str, scale: tuple[float, float]) -> Sheet:
    papers = layout.PAPERS_MM
    for key, name, choices in (("paper", paper, papers), ("transfer", transfer, TRANSFER_SIDES)):
        if name not in choices:
            raise InputError(f"{key}: {name!r}; {did_you_mean(name, choices)}")
    low, high = SHEET_DPI_RANGE
    if not low <= dpi <= high:  # NaN fails too
        raise InputError(f"dpi: {dpi:g}; expected {low:g} to {high:g}, as in 1200")
    low, high = SCALE_RANGE
    for axis, value in zip("xy", scale, strict=True):
        if not low <= value <= high:
            raise InputError(
                f"scale {axis}: {value:g} must be {low:g} to {high:g}: 100 / length in mm of the "
                f"ruler in {axis}"
            )
    return Sheet(layout.PAPERS_MM[paper], dpi, scale)


def _sticker(
    page: int, picture: CellGrid, at_px: tuple[int, int], scale: tuple[float, float],
    recipe: PatternRecipe,
) -> Sticker:  # fmt: skip
    pitch_x_mm, pitch_y_mm = picture.pitch_mm
    side_mm = recipe.printed_mm
    file_side_mm = (
        round(picture.width_px * pitch_x_mm - 2 * INSET_MM / scale[0], 9),
        round(picture.height_px * pitch_y_mm - 2 * INSET_MM / scale[1], 9),
    )
    return Sticker(
        page=page + 1,
        x_mm=round(at_px[0] * pitch_x_mm, 6),
        y_mm=round(at_px[1] * pitch_y_mm, 6),
        side_mm=side_mm,
        file_side_mm=file_side_mm,
        side_error_mm=(round(file_side_mm[0] - side_mm, 9), round(file_side_mm[1] - side_mm, 9)),
        dots_per_patch=recipe.patch_mm and recipe.patch_mm / max(picture.pitch_mm),
        print_error_mm=picture.snap_error_mm + INSET_MM,
        patch_mm=recipe.patch_mm,
        code=picture.key,
    )


def _image(file: Document, picture: CellGrid) -> int:
    """Add a lossless picture, one pixel per printer dot, so that no printer resamples it."""
    space = "/DeviceRGB" if picture.cells.ndim == 3 else "/DeviceGray"
    opening = (
        f"<< /Type /XObject /Subtype /Image /Width {picture.width_px} "
        f"/Height {picture.height_px} /ColorSpace {space} /BitsPerComponent 8 "
        "/Interpolate false /Filter /FlateDecode"
    )
    deflate = zlib.compressobj()
    packed = [deflate.compress(band.tobytes()) for band in picture.bands()]
    return file.stream(opening, b"".join([*packed, deflate.flush()]))
