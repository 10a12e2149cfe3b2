"""Independent patches, clear film, and a chessboard with its count of visible corners."""

from __future__ import annotations

import numpy as np

from deltact_fab.common import InputError

from .law import Law, Patches, PatchRecipe, uniforms

BOARD_SLACK_MM = 1e-9  # by hand, for rounding: an edge on the view's edge is not inside


def inner_corners(recipe: PatchRecipe, view_mm: tuple[float, float]) -> tuple[int, int]:
    """Number of inner corners in a centred view (x, y), along x and y."""
    inner_mm = (np.arange(1, recipe.n) - recipe.n / 2) * recipe.patch_mm
    columns, rows = (int((np.abs(inner_mm) < side / 2 - BOARD_SLACK_MM).sum()) for side in view_mm)
    return columns, rows


def check_covers(recipe: PatchRecipe, view_mm: tuple[float, float]) -> None:
    """Raise InputError unless the board fills the view and shows three corners each way.

    A lens distorts most at the edge of its view, so corners must reach it. OpenCV's corner finder
    needs three each way.
    """
    if recipe.printed_mm < max(view_mm) - BOARD_SLACK_MM:
        raise InputError(
            f"chessboard: size_mm: {recipe.printed_mm:g} mm of whole squares do not fill the "
            f"camera's view of {view_mm[0]:.2f} x {view_mm[1]:.2f} mm; at least "
            f"{np.ceil(max(view_mm) * 100) / 100:g} mm"
        )
    columns, rows = inner_corners(recipe, view_mm)
    if min(columns, rows) < 3:
        raise InputError(
            f"chessboard: patch_mm: {recipe.patch_mm:g} mm leaves {columns} x {rows} inner corners "
            f"in the camera's view; at least 3 x 3, so at most {min(view_mm) / 4:.2f} mm"
        )


def _board(recipe: PatchRecipe) -> Patches:
    place = np.arange(recipe.n)
    return ((place[:, None] + place) % 2 * 255).astype(np.uint8)[..., None]


def _iid(recipe: PatchRecipe) -> Patches:
    return (uniforms(recipe) * 256).astype(np.uint8)


def _binary(recipe: PatchRecipe) -> Patches:
    return (uniforms(recipe) >= 0.5).astype(np.uint8) * np.uint8(255)


def _no_ink(recipe: PatchRecipe) -> Patches:
    return np.full((recipe.n, recipe.n, 1), 255, np.uint8)


LAWS = {
    "iid": Law("independent uniform patches, colour or grey", _iid, may=("channels", "dots")),
    "binary": Law("independent patches, each channel 0 or 255", _binary, may=("channels", "dots")),
    "chessboard": Law("black and white squares, to calibrate the camera", _board),
    "dot-matrix": Law("dots on clear film", _no_ink, needs=("dots",), may=()),
    "transparent": Law("clear film", _no_ink, needs=(), may=()),
}
