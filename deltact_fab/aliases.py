"""Names for plain types that many signatures share; an array's shape stands in the docstring."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Progress = Callable[[int, int, str], None]
"""Told how far a job is: steps done, steps in all, what is being done."""

Point2 = tuple[float, float]
Point = tuple[float, float, float]
Vector = tuple[float, float, float]

Array = NDArray[Any]
Field = NDArray[np.float64]
Points = NDArray[np.float64]  # (n, 2) or (n, 3)
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Float = NDArray[np.float32]
Image = NDArray[np.uint8]
