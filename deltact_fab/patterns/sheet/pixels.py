"""Lossless packing of image rows: PNG's row filters and Deflate, some rows at a time.

PNG and PDF share both (ISO/IEC 15948, 9; ISO 32000-1, 7.4.4.4). A printer's raster repeats each row
of patches several times and each patch several dots: `same as above` and `difference from the left`
turn nearly all of it into zeros.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

LEVEL = 6
NONE, SUB, UP = 0, 1, 2
"""PNG's names of the row filters."""


def packed(bands: Iterable[NDArray[np.uint8]], fresh: int = SUB) -> Iterator[bytes]:
    """Deflated, filtered rows of bands (rows, width[, channels]).

    A row equal to the one above is filtered by UP, any other by `fresh`: SUB for rasters, NONE for
    patches, whose neighbours have nothing in common.
    """
    deflate = zlib.compressobj(LEVEL)
    above: NDArray[np.uint8] | None = None
    for band in bands:
        rows = np.ascontiguousarray(band).reshape(len(band), -1)
        step = band.shape[2] if band.ndim == 3 else 1
        out = np.empty((len(rows), rows.shape[1] + 1), np.uint8)
        out[:, 0] = fresh
        out[:, 1:] = rows
        if fresh == SUB:
            out[:, 1 + step :] -= rows[:, :-step]
        same = np.zeros(len(rows), bool)
        same[1:] = (rows[1:] == rows[:-1]).all(axis=1)
        same[0] = above is not None and bool((rows[0] == above).all())
        out[same, 0] = UP
        out[same, 1:] = 0
        above = rows[-1]
        yield deflate.compress(out.tobytes())
    yield deflate.flush()
