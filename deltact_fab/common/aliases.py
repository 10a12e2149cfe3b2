"""Plain types that many signatures share; an array's shape stands in the docstring."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Progress = Callable[[int, int, str], None]
"""Told how far a job is: steps done, steps in all, what is being done."""

Point2 = tuple[float, float]
Point = tuple[float, float, float]
"""A point or a vector in space."""

Array = NDArray[Any]
Field = NDArray[np.float64]
Image = NDArray[np.uint8]

_WARNING_PREFIX = "WARNING: "  # how the line of a note begins that is one


@dataclass(frozen=True)
class Note:
    """A flag of a solver, an event of a sensor, a thing left out, a remark on a run.

    id: the same whatever the text says; notes are counted and chosen by it. warns: a reader must
    not miss it.
    """

    id: str
    text: str
    warns: bool = False

    @property
    def labelled(self) -> str:
        """`ID: text`, for a text that does not name its subject."""
        return f"{self.id}: {self.text}"

    @property
    def line(self) -> str:
        """The text alone, marked where it warns."""
        return _WARNING_PREFIX * self.warns + self.text

    @classmethod
    def from_line(cls, line: str) -> Note:
        """Read back a `line`; the note has no id."""
        return cls("", line.removeprefix(_WARNING_PREFIX), line.startswith(_WARNING_PREFIX))
