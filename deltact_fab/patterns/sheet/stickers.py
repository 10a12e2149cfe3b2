"""A recipe as a sticker on a sheet: its picture, its label and its QR code."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...errors import InputError
from ..cell_grid import CellGrid
from ..raster import finest_mm
from ..recipe import PatternRecipe, draw_patches
from . import layout, page_marks
from .layout import Mark, Sheet, StickerCell, wrapped

MAX_STICKER_PX = 120_000_000
"""Largest raster of a sticker: some seconds; bands keep its memory small at any size."""


def check_dots(recipe: PatternRecipe, sheet: Sheet) -> None:
    """Raise InputError where the printer's dots are too coarse for the recipe, or too many."""
    pitch_mm = max(sheet.pitch_mm)
    for limit_mm, what in finest_mm(recipe):
        if pitch_mm > limit_mm * (1 + 1e-9):
            least = math.ceil(sheet.dpi * pitch_mm / limit_mm - 1e-9)
            raise InputError(
                f"{name(recipe)}: a printer dot at {sheet.dpi:g} dpi is {pitch_mm:.4g} mm, larger "
                f"than {what} ({limit_mm:g} mm), and cannot show it; use {least} dpi or more"
            )


def cell(
    recipe: PatternRecipe, code: str, sheet: Sheet, mirrored: bool, film_mm: tuple[float, float]
) -> StickerCell:
    """The sticker without a place. Raises InputError when the printer cannot show it."""
    check_dots(recipe, sheet)
    side_mm = recipe.printed_mm
    sticker = CellGrid(
        key=code,
        cells=draw_patches(recipe),
        size_mm=(side_mm, side_mm),
        pitch_mm=sheet.pitch_mm,
        mirrored=mirrored,
        grid=recipe.dots,
    )
    area_px = sticker.width_px * sticker.height_px
    if area_px > MAX_STICKER_PX:
        most = math.floor(sheet.dpi * math.sqrt(MAX_STICKER_PX / area_px))
        raise InputError(
            f"{name(recipe)}: {side_mm:g} mm at {sheet.dpi:g} dpi is {sticker.width_px} x "
            f"{sticker.height_px} printer dots, more than {MAX_STICKER_PX // 10**6} million; use "
            f"at most {most} dpi"
        )
    label = wrapped(_facts(recipe, code), layout.LABEL_MM, layout.TEXT_PT)
    return StickerCell(film_mm, sticker, _qr(code, sheet), tuple(label))


def _facts(recipe: PatternRecipe, code: str) -> list[str]:
    """What the label says, in pieces that stay together."""
    facts = [recipe.law]
    if recipe.patch_mm is not None:
        facts += [f"d {recipe.patch_mm:.6g} mm", f"n {recipe.n} x {recipe.n}"]
    if recipe.r is not None:
        facts.append(f"r {recipe.r!r}".removesuffix(".0"))
    facts += ["grey"] * (recipe.channels == 1)
    for key, values in (("scales", recipe.scales_mm), ("weights", recipe.weights)):
        facts += [f"{key} {', '.join(f'{v:.4g}' for v in values)}"] if values else []
    facts += [f"seed {recipe.seed}", f"{recipe.printed_mm:.6g} mm"]
    if (grid := recipe.dots) is not None:
        facts += [f"{grid.columns} x {grid.rows} dots", f"{grid.diameter_mm:g} mm {grid.colour}"]
    return [*facts, f"patches {code.rsplit('/', 1)[1].split('-')[0].lower()}"]


def _qr(code: str, sheet: Sheet) -> CellGrid:
    """The code as a QR symbol, level M, modules of whole printer dots."""
    import segno

    symbol = segno.make(code, error="m", micro=False, boost_error=False)
    dark = np.array([list(row) for row in symbol.matrix], bool)
    modules = len(dark)
    size_mm = tuple(
        modules * max(1, math.ceil(layout.MODULE_MM / pitch_mm - 1e-9)) * pitch_mm
        for pitch_mm in sheet.pitch_mm
    )
    return CellGrid(
        key=f"qr {code}",
        cells=np.where(dark, 0, 255).astype(np.uint8),
        size_mm=(size_mm[0], size_mm[1]),
        pitch_mm=sheet.pitch_mm,
    )


def put(sheet: Sheet, cell: StickerCell, x_mm: float, y_mm: float) -> tuple[list[Mark], CellGrid]:
    """A cell's marks at its place, and its sticker among them."""
    cut_x_mm, cut_y_mm = cell.cut_mm
    sticker = replace(
        cell.sticker,
        x_px=sheet.x_px(x_mm + (cut_x_mm - cell.side_mm) / 2),
        y_px=sheet.y_px(y_mm + (cut_y_mm - cell.side_mm) / 2),
    )
    width_px, height_px = sticker.width_px, sticker.height_px
    corner_px = sticker.x_px + (width_px if sticker.mirrored else 0)
    marks: list[Mark] = [sticker]
    marks += page_marks.edge_ticks(sheet, sticker.x_px, sticker.y_px, width_px, height_px)
    marks += page_marks.film_corners(sheet, x_mm, y_mm, cell.cut_mm)
    marks += page_marks.corner_mark(sheet, corner_px, sticker.y_px, sticker.mirrored)
    label_y_mm = y_mm + cut_y_mm + layout.LABEL_GAP_MM
    code_x_mm = x_mm + layout.QUIET_MM
    marks.append(replace(cell.code, x_px=sheet.x_px(code_x_mm), y_px=sheet.y_px(label_y_mm)))
    text_x_mm = code_x_mm + cell.code_mm + layout.QUIET_MM
    for k, line in enumerate(cell.label):
        baseline_mm = label_y_mm + 1.8 + k * layout.line_mm(layout.TEXT_PT)
        marks.append(sheet.words(text_x_mm, baseline_mm, line))
    return marks, sticker


def name(recipe: PatternRecipe) -> str:
    """A recipe in a few words, for messages."""
    patch = "" if recipe.patch_mm is None else f", d {recipe.patch_mm:g} mm"
    return f"sticker ({recipe.law}{patch}, {recipe.printed_mm:g} mm)"
