"""The corners of a board in an image, and which of the board's corners they are."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ...aliases import Array
from ...errors import InputError
from .board import Checkerboard

FEWEST = 5
"""Inner corners each way that are looked for on a skin; the finder then grows the grid."""
WINDOW = 0.3
"""Half side of the window that refines a corner, in distances to the nearest corner."""
WINDOWS_PX = (2, 7)
BORDER_PX = 4
CLEARLY = 0.6
"""The skin's middle must lie so much nearer to its guess than the next square that might be it."""


@dataclass(frozen=True)
class Corners:
    """What one image shows of a board.

    px: (n, 2) in the image. index: (n, 2) whole numbers, column and row of each among the board's
    inner corners; of a board that is no skin up to half a turn, which its pose takes up.
    """

    source: str
    board: Checkerboard
    px: NDArray[np.float64]
    index: NDArray[np.int64]

    @property
    def board_mm(self) -> NDArray[np.float64]:
        """Where the corners lie in the plane of the board, (n, 2) mm."""
        return self.board.at_mm(self.index)


def read_image(path: Path) -> NDArray[np.uint8]:
    """An image file as (h, w, 3) BGR. Raises InputError naming the file."""
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    image = cv2.imdecode(np.frombuffer(path.read_bytes() or b"\0", np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{path}: not an image that can be read")
    return np.asarray(image, np.uint8)


def find(image: Array, board: Checkerboard, source: str) -> Corners | None:
    """The board's inner corners in an image (h, w, 3) BGR, None where no board is found.

    Sector-based detection (Duda and Frese, 2018), each corner refined on its gradients in a window
    that stays clear of its neighbours. A board must be seen whole. A skin is seen in part: the
    camera is taken to be turned by less than 45 degrees about its axis, and the skin's middle is
    the square of the right colour nearest to the image's middle.

    Raises InputError where more or other corners are found than the board has, or where the middle
    of a skin cannot be told.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    columns, rows = board.corners
    least = (min(FEWEST, columns), min(FEWEST, rows)) if board.skin else (columns, rows)
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    seen, px, meta = cv2.findChessboardCornersSBWithMeta(grey, least, flags)
    if not seen:
        return None
    grid = _upright(np.asarray(px, np.float64).reshape(*meta.shape[:2], 2))
    if not board.skin and grid.shape[:2] == (columns, rows) != (rows, columns):
        # A board that lies across: count along its own sides.
        grid = np.ascontiguousarray(grid.transpose(1, 0, 2)[::-1])
    found = grid.shape[1], grid.shape[0]
    if (board.skin and (found[0] > columns or found[1] > rows)) or (
        not board.skin and found != (columns, rows)
    ):
        raise InputError(
            f"{source}: {found[0]} x {found[1]} inner corners found, and a board of {board} has "
            f"{columns} x {rows}: another board?"
        )
    inside = _inside(grey, grid)
    grid = _refined(grey, grid, inside)
    index = np.stack(np.meshgrid(np.arange(found[0]), np.arange(found[1])), -1)
    if board.skin:
        index = index + _shift(grey, grid, inside, board, source)
    return Corners(source, board, grid[inside], index[inside])


def _upright(grid: Array) -> Array:
    """The rectangle (rows, columns, 2) px turned so that columns run to +x and rows to +y.

    A finder may give it by columns, turned or mirrored; an image of a board is never a mirror's.
    """
    along = np.diff(grid, axis=1).mean((0, 1))
    if abs(along[0]) < abs(along[1]):
        grid = grid.transpose(1, 0, 2)
    if np.diff(grid, axis=1).mean((0, 1))[0] < 0:
        grid = grid[:, ::-1]
    if np.diff(grid, axis=0).mean((0, 1))[1] < 0:
        grid = grid[::-1]
    return np.ascontiguousarray(grid)


def _inside(grey: Array, grid: Array) -> NDArray[np.bool_]:
    """Which corners lie well in the image; the finder also guesses some beyond its border."""
    limits = np.array(grey.shape[::-1]) - 1 - BORDER_PX
    return np.asarray(np.all((grid >= BORDER_PX) & (grid <= limits), axis=-1))


def _refined(grey: Array, grid: Array, inside: Array) -> Array:
    """The same corners, each refined in a window as large as its neighbours allow."""
    rows, columns = grid.shape[:2]
    nearest_px = np.full((rows, columns), np.inf)
    down = np.linalg.norm(np.diff(grid, axis=0), axis=-1)
    right = np.linalg.norm(np.diff(grid, axis=1), axis=-1)
    for distance, here in (
        (down, nearest_px[1:]),
        (down, nearest_px[:-1]),
        (right, nearest_px[:, 1:]),
        (right, nearest_px[:, :-1]),
    ):
        np.minimum(here, distance, out=here)
    half_px = np.clip(np.rint(WINDOW * nearest_px), *WINDOWS_PX).astype(int)
    refined = grid.copy()
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    for half in np.unique(half_px):
        at = (half_px == half) & inside
        if not at.any():
            continue
        start = grid[at].astype(np.float32).reshape(-1, 1, 2)
        new = cv2.cornerSubPix(grey, start, (int(half), int(half)), (-1, -1), stop).reshape(-1, 2)
        # One that wanders off has met something else than its corner.
        stays = np.linalg.norm(new - grid[at], axis=1) < half / 2
        refined[at] = np.where(stays[:, None], new, grid[at])
    return refined


def _shift(
    grey: Array, grid: Array, inside: Array, board: Checkerboard, source: str
) -> NDArray[np.int64]:
    """What to add to (column, row) in the rectangle to have the skin's own. Raises InputError."""
    rows, columns = grid.shape[:2]
    middle_px = (np.array(grey.shape[::-1]) - 1) / 2
    # Where the guess of the origin lies in the rectangle, from an affine map of the corners near it
    near = np.argsort(np.linalg.norm(grid.reshape(-1, 2) - middle_px, axis=1))[:16]
    where = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)
    px = np.column_stack((grid.reshape(-1, 2)[near] - middle_px, np.ones(len(near))))
    guess = np.linalg.lstsq(px, where[near], rcond=None)[0][2]
    # The square right of and below corner (i, j) of the skin is (i + 1, j + 1), dark where even.
    dark_even = _dark_even(grey, grid, inside)
    half = np.array([board.nx, board.ny]) / 2 - 1  # the origin, counted in the skin's corners
    options: list[tuple[float, tuple[int, int]]] = []
    for shift in itertools.product(
        range(board.corners[0] - columns + 1), range(board.corners[1] - rows + 1)
    ):
        if (sum(shift) % 2 == 0) == dark_even:
            off_mm = float(np.linalg.norm(guess + shift - half)) * board.square_mm
            options.append((off_mm, shift))
    if not options:
        raise InputError(
            f"{source}: the squares have the colours of another board, or its negative"
        )
    options.sort()
    (off_mm, shift), others = options[0], options[1:]
    if others and off_mm > CLEARLY * others[0][0]:
        raise InputError(
            f"{source}: the skin's middle lies {off_mm:.2f} mm off the image's, so that it might "
            "be one square or another: put skin and camera in the middle"
        )
    return np.array(shift)


def _dark_even(grey: Array, grid: Array, inside: Array) -> bool:
    """Whether squares whose first corner has an even column + row are the dark ones."""
    middles = (grid[1:, 1:] + grid[:-1, 1:] + grid[1:, :-1] + grid[:-1, :-1]) / 4
    rows, columns = middles.shape[:2]
    even = (np.arange(rows)[:, None] + np.arange(columns)) % 2 == 0
    whole = inside[1:, 1:] & inside[:-1, 1:] & inside[1:, :-1] & inside[:-1, :-1]
    at = np.rint(middles[whole]).astype(int)
    values, even = grey[at[:, 1], at[:, 0]].astype(float), even[whole]
    return bool(values[even].mean() < values[~even].mean())
