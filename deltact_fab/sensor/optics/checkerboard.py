"""Checkerboard for calibrating a lens, and the file that marks simulated photographs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import InputError

BOARD_PATTERN = re.compile(r"(\d+)x(\d+)x(\d+(?:\.\d*)?|\.\d+)")
MAX_BOARD_SQUARES = 200  # by hand: more are a slip; a photograph would not resolve them


@dataclass(frozen=True)
class Checkerboard:
    """Board of nx x ny squares of `square_mm`; the first square, at (-x, -y), is dark.

    `skin`: the board is the sensor's own skin, centred on the sensor's origin with rows along x;
    the camera may see only a part.
    """

    mark_file: ClassVar[str] = "photographs.json"
    """File next to simulated images: {"simulated": true, "seed": N}."""
    nx: int
    ny: int
    square_mm: float
    skin: bool = False

    @classmethod
    def parse(cls, text: str, option: str = "--board") -> Checkerboard:
        """Parse NXxNYxMM, e.g. 9x7x3: squares along x and y, side in mm. Raises InputError."""
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
        """Numbers of inner corners along x and y."""
        return self.nx - 1, self.ny - 1

    def __str__(self) -> str:
        """Format for the command line."""
        return f"{self.nx}x{self.ny}x{self.square_mm:g}"

    def at_mm(self, index: NDArray[np.integer]) -> NDArray[np.float64]:
        """Positions in mm of inner corners (..., 2), counted from 0 at (-x, -y), on the board.

        The origin is the centre of the board.
        """
        half = np.array([self.nx, self.ny]) / 2
        return np.asarray((index + 1 - half) * self.square_mm, np.float64)
