"""Rows of PNG filters, undone: what a reader of the sheet's pictures sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deltact_fab.patterns.sheet.pixels import SUB, UP


def unfiltered(data: bytes, width: int, channels: int) -> NDArray[np.uint8]:
    """The rows of filtered, inflated data, (rows, width, channels); filters NONE, SUB and UP."""
    lines = np.frombuffer(data, np.uint8).reshape(-1, width * channels + 1)
    rows = lines[:, 1:].reshape(-1, width, channels).copy()
    sub = lines[:, 0] == SUB
    rows[sub] = np.cumsum(rows[sub], axis=1, dtype=np.uint8)
    for i in np.flatnonzero(lines[:, 0] == UP):
        rows[i] += rows[i - 1]
    return rows
