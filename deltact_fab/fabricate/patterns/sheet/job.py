"""A print job: many stickers on pages of exact millimetres, with marks that identify them.

Whether a sticker is printed mirrored depends on which side of the film the ink is on (paper,
Fabrication Process; frames as in `optics`). The camera is inside, looks out along +z, and must see
the recipe as designed, with row 0, column 0 at (-x, -y).

- `face-down`: the printed side is laid on the gel. The camera sees the printed side of the ink, as
  a person who looks at the sheet does. The sheet shows the array as it is.
- `slide`: the film slides off its backing onto the gel, film first. The camera looks through gel
  and film at the back of the ink, where left and right are exchanged. The sheet shows the array
  with its columns reversed.

In both cases an F stands beside the pattern at the corner (-x, -y), mirrored with the sticker. It
reads correctly from the side that lies on the gel, where the camera is; if it does not, the film is
the wrong way round. Labels and QR codes are never mirrored.

A scale correction stretches everything, the rulers too: a corrected sheet is right when its own
rulers measure 100 mm. If they do not, multiply the correction by 100 / what they measure.
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

TRANSFERS = ("face-down", "slide")
DPI_RANGE = (100.0, 9600.0)
SCALE_RANGE = (0.9, 1.1)
MAX_STICKERS = 2000


@dataclass(frozen=True)
class Sticker:
    """A printed sticker. x_mm, y_mm: its top left corner from the page's, on the real print.

    file_side_mm: the side of the picture in the file, (x, y) on the real print, in whole printer
    dots. side_error_mm: that less side_mm, which is n d. print_error_mm: of the worst patch edge,
    from its true place about the sticker's centre.
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
    """What `write` wrote. print_error_mm: the worst of all stickers."""

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
    progress: Progress | None = None,
) -> SheetReport:
    """Write the stickers as a PDF, on as many pages as they need.

    scale: 100 / what the ruler in (x, y) measures, times the scale of the sheet it is on.
    Memory is bounded by the compressed file; equal arguments and versions give equal bytes.

    Raises InputError for anything that cannot be printed as requested, or that the sensor's camera
    cannot use (`raster.check_seen`): nothing is written then.
    """
    if out.suffix.lower() != ".pdf":
        raise InputError(f"{out}: a sheet is a PDF: end the name in .pdf")
    paper = next((name for name in layout.PAPERS if name.lower() == paper.lower()), paper)
    sheet = _checked_sheet(paper, dpi, transfer, scale)
    if not recipes:
        raise InputError("a sheet needs at least one recipe")
    if not 1 <= copies <= MAX_STICKERS or len(recipes) * copies > MAX_STICKERS:
        raise InputError(
            f"copies: {copies} of {len(recipes)} recipes; at least 1, and at most {MAX_STICKERS} "
            "stickers in all"
        )
    tell = progress or (lambda done, total, what: None)
    sensor = sensor or SensorDimensions()
    total = len(recipes) + 1
    cells: dict[PatternRecipe, StickerCell] = {}
    for k, recipe in enumerate(recipes):
        tell(k, total, f"sticker {k + 1}")
        if recipe in cells:
            continue
        try:
            check_seen(recipe, sensor.optics.view_mm)
        except InputError as why:
            raise InputError(f"{page_marks.name(recipe)}: {why}") from why
        cells[recipe] = page_marks.cell(
            recipe, encode(recipe), sheet, transfer == "slide", sensor.skin.film_mm()
        )
    tell(len(recipes), total, "file")
    order = [recipe for recipe in recipes for _ in range(copies)]
    names = [page_marks.name(recipe) for recipe in order]
    head, top_mm = page_marks.header(sheet, paper, transfer)
    places = layout.placed(sheet, [cells[recipe] for recipe in order], names, top_mm)
    pages = places[-1].page + 1
    file, images = Document(), dict[str, int]()
    found: list[Sticker] = []
    for page in range(pages):
        marks, used = list(head), dict[str, int]()
        for place in (p for p in places if p.page == page):
            recipe = order[place.cell]
            cell = cells[recipe]
            for picture in (cell.sticker, cell.code):
                if picture.key not in images:
                    images[picture.key] = _image(file, picture)
                used[f"I{images[picture.key]}"] = images[picture.key]
            on_page, at_px = page_marks.put(sheet, cell, place.x_mm, place.y_mm, images)
            marks += on_page
            found.append(_sticker(page, cell.sticker, at_px, scale, recipe))
        marks += page_marks.footer(sheet, page, pages)
        file.page(sheet.size_pt, "\n".join(marks), used)
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
        stickers=tuple(found),
        print_error_mm=max(s.print_error_mm for s in found),
        bytes=len(content),
        sha256=hashlib.sha256(content).hexdigest(),
        codes=codes,
    )


def _checked_sheet(paper: str, dpi: float, transfer: str, scale: tuple[float, float]) -> Sheet:
    for key, name, known in (("paper", paper, layout.PAPERS), ("transfer", transfer, TRANSFERS)):
        if name not in known:
            raise InputError(f"{key}: {name!r}; {did_you_mean(name, known)}")
    low, high = DPI_RANGE
    if not low <= dpi <= high:  # NaN fails too
        raise InputError(f"dpi: {dpi:g}; a printer has {low:g} to {high:g}, as in 1200")
    low, high = SCALE_RANGE
    for axis, value in zip("xy", scale, strict=True):
        if not low <= value <= high:
            raise InputError(
                f"scale {axis}: {value:g} must be {low:g} to {high:g}: 100 / what the ruler in "
                f"{axis} measures in mm"
            )
    return Sheet(layout.PAPERS[paper], dpi, scale)


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
    """Add a picture, lossless, one pixel a printer dot, so that no printer resamples it."""
    space = "/DeviceRGB" if picture.cells.ndim == 3 else "/DeviceGray"
    opening = (
        f"<< /Type /XObject /Subtype /Image /Width {picture.width_px} "
        f"/Height {picture.height_px} /ColorSpace {space} /BitsPerComponent 8 "
        "/Interpolate false /Filter /FlateDecode"
    )
    deflate = zlib.compressobj()
    packed = [deflate.compress(band.tobytes()) for band in picture.bands()]
    return file.stream(opening, b"".join([*packed, deflate.flush()]))
