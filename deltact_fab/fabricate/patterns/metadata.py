"""Metadata in a pattern's PNG: recipe, scale and dot positions.

The image alone is enough to find every dot.
"""

from __future__ import annotations

import hashlib
import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import MM_PER_INCH, InputError, parse_json, validate
from deltact_fab.version import PACKAGE_VERSION

from .recipe import PatternRecipe

if TYPE_CHECKING:
    from PIL import Image

ZLIB_LEVEL = 6  # by hand, zlib's default: more costs time for few bytes
MAX_TABLE_BYTES = 1_000_000
"""Of dots in a PNG; by definition of Pillow's MAX_TEXT_CHUNK readers refuse more than 1 MiB."""
FRAME_NOTE = (
    "x_px = x_mm / mm_per_px + (width - 1) / 2, y_px = y_mm / mm_per_px + (height - 1) / 2; "
    "pixel (0, 0) has its centre at 0, 0 and is the corner at -x, -y as the camera sees it"
)


def png(
    image: NDArray[np.uint8],
    recipe: PatternRecipe,
    mm_per_px: float,
    dpi: float | None,
    table: bytes | None,
) -> bytes:
    """Encode a pattern's PNG; table: CSV of its dots.

    A table beyond MAX_TABLE_BYTES is replaced by its hash; the recipe can regenerate it.

    pHYs holds whole pixels per metre, so its size is right to 0.5 px/m; the text is exact.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    notes = PngInfo()
    for key, value in _text(recipe, mm_per_px, dpi, image.shape[:2]).items():
        notes.add_text(key, value)
    if table is not None:
        notes.add_text("dots_sha256", hashlib.sha256(table).hexdigest())
        if len(table) <= MAX_TABLE_BYTES:
            notes.add_text("dots_csv", table.decode(), zip=True)
    per_inch = MM_PER_INCH / mm_per_px
    file = io.BytesIO()
    Image.fromarray(image).save(
        file,
        "PNG",
        compress_level=ZLIB_LEVEL,
        optimize=False,
        dpi=(per_inch, per_inch),
        pnginfo=notes,
    )
    return file.getvalue()


@contextmanager
def open_image(path: Path) -> Iterator[Image.Image]:
    """Open an image file of any size. Raises InputError if Pillow cannot read it."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            # A page of A4 at 1200 dpi has more pixels than Pillow trusts a file to have
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path) as image:
                yield image
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (
        UnidentifiedImageError, OSError, SyntaxError, ValueError, Image.DecompressionBombError
    ) as error:  # fmt: skip
        raise InputError(f"{path}: not a readable image: {error}") from error


def read_recipe(path: Path) -> PatternRecipe:
    """Read the recipe from a PNG of `pattern make`. Raises InputError if there is none."""
    with open_image(path) as image:
        text = dict(getattr(image, "text", {}))
    if "recipe" not in text:
        raise InputError(f"{path}: contains no recipe; expected a PNG from 'pattern make'")
    source = f"{path}: recipe"
    return validate(PatternRecipe, parse_json(text["recipe"], source), source)


def _text(
    recipe: PatternRecipe, mm_per_px: float, dpi: float | None, size_px: tuple[int, ...]
) -> dict[str, str]:
    """Text chunks for people and for `read_recipe`."""
    values = {
        "law": recipe.law,
        "d_mm": recipe.patch_mm,
        "r": recipe.r,
        "n": None if recipe.patch_mm is None else recipe.n,
        "seed": recipe.seed,
        "size_mm": recipe.printed_mm,
        "mm_per_px": mm_per_px,
        "width_px": size_px[1],
        "height_px": size_px[0],
        "recipe": recipe.model_dump_json(exclude_none=True),
        "dpi": dpi,
    }
    text = {"Software": f"deltact-fab {PACKAGE_VERSION}"}
    text |= {key: str(value) for key, value in values.items() if value is not None}
    if recipe.dots is not None:
        grid = recipe.dots
        text["dots"] = f"{grid.columns} x {grid.rows}, {grid.diameter_mm:g} mm, {grid.colour}"
        text["frame"] = FRAME_NOTE
    return text
