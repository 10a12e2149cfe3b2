"""Type aliases of many signatures; docstrings state the shapes of arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Progress = Callable[[int, int, str], None]
"""Progress callback: steps done, steps in total, current step."""

Point2 = tuple[float, float]
Point = tuple[float, float, float]
"""A point or a vector in space."""

Array = NDArray[Any]
Field = NDArray[np.float64]
Image = NDArray[np.uint8]

_WARNING_PREFIX = "WARNING: "  # prefix of a warning's line


@dataclass(frozen=True)
class Note:
    """Remark on a result: solver flag, sensor event, skipped item.

    id: independent of the text; notes are counted and filtered by it. warns: shown as a warning.
    """

    id: str
    text: str
    warns: bool = False

    @property
    def labelled(self) -> str:
        """Text with its id, `ID: text`."""
        return f"{self.id}: {self.text}"

    @property
    def line(self) -> str:
        """Text, with the prefix of a warning if it warns."""
        return _WARNING_PREFIX * self.warns + self.text

    @classmethod
    def from_line(cls, line: str) -> Note:
        """Parse a `line`; the note has no id."""
        return cls("", line.removeprefix(_WARNING_PREFIX), line.startswith(_WARNING_PREFIX))
