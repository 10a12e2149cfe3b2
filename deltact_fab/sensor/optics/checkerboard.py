"""The board that a lens is calibrated with, and the file that marks its simulated photographs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import InputError

BOARD_PATTERN = re.compile(r"(\d+)x(\d+)x(\d+(?:\.\d*)?|\.\d+)")
MAX_BOARD_SQUARES = 200


@dataclass(frozen=True)
class Checkerboard:
    """nx x ny squares of `square_mm`; the first square, at (-x, -y), is dark.

    `skin`: it is the sensor's own skin, which lies on the face with its middle at the sensor's
    origin and its rows along x, and of which the camera may see only a part.
    """

    mark_file: ClassVar[str] = "photographs.json"
    """Beside simulated images: {"simulated": true, "seed": N}."""
    nx: int
    ny: int
    square_mm: float
    skin: bool = False

    @classmethod
    def parse(cls, text: str, option: str = "--board") -> Checkerboard:
        """Of NXxNYxMM, as in 9x7x3: squares along x and y and their side. Raises InputError."""
        match = BOARD_PATTERN.fullmatch(text.strip())
        nx, ny, side = (int(match[1]), int(match[2]), float(match[3])) if match else (0, 0, 0.0)
        if not (min(nx, ny) >= 4 and max(nx, ny) <= MAX_BOARD_SQUARES and 0.05 <= side <= 100):
            raise InputError(
                f"{option}: {text!r}; as in 9x7x3: 4 to {MAX_BOARD_SQUARES} squares along x and y "
                "and their side, 0.05 to 100 mm"
            )
        return cls(nx, ny, side)

    @property
    def corners(self) -> tuple[int, int]:
        """Inner corners along x and y; four squares meet in each."""
        return self.nx - 1, self.ny - 1

    def __str__(self) -> str:
        """As the command line takes it."""
        return f"{self.nx}x{self.ny}x{self.square_mm:g}"

    def at_mm(self, index: NDArray[np.integer]) -> NDArray[np.float64]:
        """Inner corners (..., 2), counted from 0 at (-x, -y), to the board's own plane, mm.

        Its origin is the middle of the whole board.
        """
        half = np.array([self.nx, self.ny]) / 2
        return np.asarray((index + 1 - half) * self.square_mm, np.float64)
