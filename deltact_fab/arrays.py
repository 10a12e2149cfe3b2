"""What an array in a signature holds; its shape stands in the docstring that takes it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Field = NDArray[np.float64]
Points = NDArray[np.float64]  # (n, 2) or (n, 3)
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Float = NDArray[np.float32]
Image = NDArray[np.uint8]
