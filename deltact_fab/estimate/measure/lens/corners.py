"""The corners of a board in an image, and which of the board's corners they are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Array, InputError
from deltact_fab.sensor import Checkerboard

FEWEST = 5  # inner corners each way that are looked for on a skin; the finder then grows the grid
WINDOW = 0.3  # half side of the window that refines a corner, in distances to the nearest corner
WINDOWS_PX = (2, 7)
BORDER_PX = 4
SKIN_SHARES = (0.5, 0.7, 1.0)
"""Of the image's sides, around its middle, in which a skin is looked for."""
ALTERNATING = 0.97
"""Share of the steps from square to square that must change from dark to light or back."""
MIN_CONTRAST = 8.0  # grey levels between the squares that meet in a corner of a skin
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
CLEARLY = 0.6
"""The skin's middle must lie so much nearer to its guess than the next square that might be it."""


@dataclass(frozen=True)
class Corners:
    """What one image shows of a board.

    px: (n, 2) in the image. index: (n, 2), column and row of each among the board's inner corners;
    of a board that is no skin up to half a turn, which its pose takes up.
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


def find_corners(image: Array, board: Checkerboard, source: str) -> Corners | None:
    """The board's inner corners in an image (h, w, 3) BGR, None where no board is found.

    Sector-based detection (Duda and Frese, 2018). A board must be seen whole. A skin is seen in
    part and followed outwards from the image's middle: the camera is taken to be turned by less
    than 45 degrees, and the skin's middle is the square of the right colour nearest to the image's.

    Raises InputError for corners of another board, and for a skin whose middle cannot be told.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    columns, rows = board.corners
    seed = _seed(grey, board)
    if seed is None:
        return None
    grid, inside = seed, _inside(grey, seed)
    if board.skin:
        grid, inside = _grow_grid(grey, grid, inside, board)
    elif grid.shape[:2] == (columns, rows) != (rows, columns):
        # A board that lies across: count along its own sides.
        grid = np.ascontiguousarray(grid.transpose(1, 0, 2)[::-1])
        inside = np.ascontiguousarray(inside.T[::-1])
    size = grid.shape[1], grid.shape[0]
    too_large = size[0] > columns or size[1] > rows
    if too_large or (not board.skin and size != (columns, rows)):
        raise InputError(
            f"{source}: {size[0]} x {size[1]} inner corners found, and a board of {board} has "
            f"{columns} x {rows}: another board?"
        )
    grid = _refine_corners(grey, grid, inside)
    index = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), -1)
    if board.skin:
        index = index + _skin_offset(grey, grid, inside, board, source)
    return Corners(source, board, grid[inside], index[inside])


def _seed(grey: Array, board: Checkerboard) -> Array | None:
    """A rectangle of corners (rows, columns, 2) px, upright; of a skin any, else the whole board.

    A skin is looked for in the middle first: under uneven light a finder may leave corners out.
    """
    min_corners = tuple(min(FEWEST, n) for n in board.corners) if board.skin else board.corners
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    for share in SKIN_SHARES if board.skin else (1.0,):
        y, x = (round(n * (1 - share) / 2) for n in grey.shape)
        part = np.ascontiguousarray(grey[y : grey.shape[0] - y, x : grey.shape[1] - x])
        detected, px, meta = cv2.findChessboardCornersSBWithMeta(part, min_corners, flags)
        if detected:
            grid = _turn_upright(np.asarray(px, np.float64).reshape(*meta.shape[:2], 2) + (x, y))
            if not board.skin:
                grid = _trim_rim(grey, grid)
            if _is_alternating(grey, grid):
                return grid
    return None


def _trim_rim(grey: Array, grid: Array) -> Array:
    """The rectangle without sides along the board's edge: a finder may take them for inner ones."""
    for side in range(4):
        turned = np.rot90(grid, side)
        if len(turned) > 2 and np.mean(_corners_near(grey, turned[-1], turned[-2])[1]) < 0.5:
            grid = np.rot90(turned[:-1], -side)
    return np.ascontiguousarray(grid)


def _squares(grey: Array, grid: Array, inside: Array) -> tuple[Array, Array, Array]:
    """Of the squares between corners, (rows - 1, columns - 1) each: grey level, whether all four
    are inside, whether column and row add up to an even number."""
    complete = inside[1:, 1:] & inside[:-1, 1:] & inside[1:, :-1] & inside[:-1, :-1]
    middles = (grid[1:, 1:] + grid[:-1, 1:] + grid[1:, :-1] + grid[:-1, :-1]) / 4
    xy = np.rint(np.where(complete[..., None], middles, 0)).astype(int)
    rows, columns = complete.shape
    even = (np.arange(rows)[:, None] + np.arange(columns)) % 2 == 0
    return (cv2.blur(grey, (3, 3))[xy[..., 1], xy[..., 0]].astype(float), complete, even)


def _is_alternating(grey: Array, grid: Array) -> bool:
    """Whether the squares between corners are dark and light in turn: none was left out."""
    values, complete, even = _squares(grey, grid, _inside(grey, grid))
    sign = np.where(even, 1, -1)
    right = (np.diff(values, axis=1) * sign[:, 1:])[complete[:, 1:] & complete[:, :-1]]
    down = (np.diff(values, axis=0) * sign[1:])[complete[1:] & complete[:-1]]
    steps = np.concatenate((right, down))
    steps *= np.sign(np.median(steps)) if len(steps) else 1.0
    return len(steps) > 0 and bool(np.mean(steps > 0) > ALTERNATING)


def _turn_upright(grid: Array) -> Array:
    """The rectangle (rows, columns, 2) px turned so that columns run to +x and rows to +y."""
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


def _grow_grid(
    grey: Array, grid: Array, inside: Array, board: Checkerboard
) -> tuple[Array, NDArray[np.bool_]]:
    """The rectangle with all that lies around it, and which of its corners are seen.

    Each side is continued by the parabola of its last three corners, as long as there are some.
    """
    max_size = board.corners[::-1]
    sides = [0, 1, 2, 3]
    while sides:
        for side in tuple(sides):
            # The side to be continued is made the last row.
            turned, turned_inside = np.rot90(grid, side), np.rot90(inside, side)
            if len(turned) < 3 or len(turned) >= max_size[side % 2]:
                sides.remove(side)
                continue
            guess = 3 * turned[-1] - 3 * turned[-2] + turned[-3]
            row_px, detected = _corners_near(grey, guess, turned[-1])
            if not detected.any():
                sides.remove(side)
                continue
            grid = np.rot90(np.concatenate((turned, row_px[None])), -side)
            inside = np.rot90(np.concatenate((turned_inside, detected[None])), -side)
    return np.ascontiguousarray(grid), np.ascontiguousarray(inside)


def _corners_near(grey: Array, guess: Array, inner: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Corners (n, 2) near guesses (n, 2) px of a row, and which are there.

    before: the row beside it. In a corner two dark squares meet two light ones.
    """
    corners = guess.copy()
    inside = _inside(grey, guess)
    out, along = guess - inner, np.gradient(guess, axis=0)
    pitch = np.minimum(np.linalg.norm(out, axis=1), np.linalg.norm(along, axis=1))
    for k in np.flatnonzero(inside):
        half = int(np.clip(np.rint(WINDOW * pitch[k]), *WINDOWS_PX))
        start = guess[k].astype(np.float32).reshape(1, 1, 2)
        new = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), _STOP).reshape(2)
        inside[k] = np.linalg.norm(new - guess[k]) < WINDOW * pitch[k]
        if inside[k]:
            corners[k] = new
    squares = [corners + WINDOW * (a * out + b * along) for a in (-1, 1) for b in (-1, 1)]
    last = np.array(grey.shape[::-1]) - 1
    samples = [np.rint(np.clip(square, 0, last)).astype(int) for square in squares]
    first, second, third, fourth = (grey[p[:, 1], p[:, 0]].astype(float) for p in samples)
    low, high = np.minimum(first, fourth), np.maximum(first, fourth)
    contrast = np.maximum(low - np.maximum(second, third), np.minimum(second, third) - high)
    spread = np.maximum(high - low, np.abs(second - third))
    return corners, np.asarray(inside & (contrast > np.maximum(MIN_CONTRAST, spread)))


def _refine_corners(grey: Array, grid: Array, inside: Array) -> Array:
    """The same corners, each refined in a window as large as its neighbours allow."""
    rows, columns = grid.shape[:2]
    nearest_px = np.full((rows, columns), np.inf)
    down = np.linalg.norm(np.diff(grid, axis=0), axis=-1)
    right = np.linalg.norm(np.diff(grid, axis=1), axis=-1)
    for distance, *sides in (
        (down, nearest_px[1:], nearest_px[:-1]),
        (right, nearest_px[:, 1:], nearest_px[:, :-1]),
    ):
        for side in sides:
            np.minimum(side, distance, out=side)
    half_px = np.clip(np.rint(WINDOW * nearest_px), *WINDOWS_PX).astype(int)
    refined = grid.copy()
    for half in np.unique(half_px[inside]):
        selected = (half_px == half) & inside
        start = grid[selected].astype(np.float32).reshape(-1, 1, 2)
        new = cv2.cornerSubPix(grey, start, (int(half), int(half)), (-1, -1), _STOP).reshape(-1, 2)
        # One that wanders off has met something else than its corner.
        stays = np.linalg.norm(new - grid[selected], axis=1) < half / 2
        refined[selected] = np.where(stays[:, None], new, grid[selected])
    return refined


def _skin_offset(
    grey: Array, grid: Array, inside: Array, board: Checkerboard, source: str
) -> NDArray[np.int64]:
    """What to add to (column, row) in the rectangle to have the skin's own. Raises InputError."""
    rows, columns = grid.shape[:2]
    middle_px = (np.array(grey.shape[::-1]) - 1) / 2
    # Where the guess of the origin lies in the rectangle, from an affine map of the corners near it
    near = np.argsort(np.linalg.norm(grid.reshape(-1, 2) - middle_px, axis=1))[:16]
    indices = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)
    px = np.column_stack((grid.reshape(-1, 2)[near] - middle_px, np.ones(len(near))))
    guess = np.linalg.lstsq(px, indices[near], rcond=None)[0][2]
    # The square right of and below corner (i, j) of the skin is (i + 1, j + 1), dark where even.
    values, complete, even = _squares(grey, grid, inside)
    dark_even = bool(values[complete & even].mean() < values[complete & ~even].mean())
    half = np.array([board.nx, board.ny]) / 2 - 1  # the origin, counted in the skin's corners
    shifts = np.argwhere(np.ones((board.corners[0] - columns + 1, board.corners[1] - rows + 1)))
    shifts = shifts[(shifts.sum(axis=1) % 2 == 0) == dark_even]
    if not len(shifts):
        raise InputError(
            f"{source}: the squares have the colours of another board, or its negative"
        )
    off_mm = np.linalg.norm(guess + shifts - half, axis=1) * board.square_mm
    order = np.argsort(off_mm, kind="stable")
    if len(order) > 1 and off_mm[order[0]] > CLEARLY * off_mm[order[1]]:
        raise InputError(
            f"{source}: the skin's middle lies {off_mm[order[0]]:.2f} mm off the image's, so that "
            "it might be one square or another: put skin and camera in the middle"
        )
    return np.asarray(shifts[order[0]])
