"""Detection and indexing of the corners of a board in an image."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import ImageFolder
from deltact_fab.common import Array, InputError, RunFailed
from deltact_fab.sensor import Checkerboard

MIN_SKIN_CORNERS = 5  # each way, to seed the grid of a skin; by hand: fewer match other textures
REFINE_SHARE = 0.3  # half side of the window over the corner distance; measured, decision 0019
REFINE_LIMITS_PX = (2, 7)  # of that half side; by hand: smaller is noisy, larger sees distortion
CORNER_BORDER_PX = 4  # by hand: the refining window must lie inside the image
SKIN_SHARES = (0.5, 0.7, 1.0)  # of the image's sides, searched for a skin in turn; decision 0019
ALTERNATING_SHARE = 0.97  # of steps between squares that alternate dark and light; by hand
MIN_CORNER_CONTRAST = 8.0  # grey levels between squares at a skin's corner; by hand: above noise
_REFINE_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
CLEAR_MIDDLE_RATIO = 0.6  # of distances, best to second best middle; by hand: nearer is ambiguous


@dataclass(frozen=True)
class Corners:
    """Corners of a board detected in one image.

    px: (n, 2) in the image. index: (n, 2), column and row of each among the board's inner corners;
    except for a skin ambiguous by half a turn, which the pose absorbs.
    """

    source: str
    board: Checkerboard
    px: NDArray[np.float64]
    index: NDArray[np.int64]

    @property
    def board_mm(self) -> NDArray[np.float64]:
        """Corner positions in the plane of the board, (n, 2) mm."""
        return self.board.at_mm(self.index)


def read_image(path: Path) -> NDArray[np.uint8]:
    """Read an image file as (h, w, 3) BGR. Raises InputError naming the file."""
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        return ImageFolder.load(path)
    except RunFailed as error:
        raise InputError(str(error)) from error


def find_corners(image: Array, board: Checkerboard, source: str) -> Corners | None:
    """Find the board's inner corners in an image (h, w, 3) BGR; None if there is no board.

    Sector-based detection (Duda and Frese, 2018). A board must be fully visible. A skin is partly
    visible and followed outwards from the image's middle: the camera must be turned by less than
    45 degrees, and the skin's middle is the square of the right colour nearest to the image's.

    Raises InputError for corners of another board, and for a skin with an ambiguous middle.
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
            f"{source}: {size[0]} x {size[1]} inner corners found, but a board of {board} has "
            f"{columns} x {rows}: another board?"
        )
    grid = _refine_corners(grey, grid, inside)
    index = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), -1)
    if board.skin:
        index = index + _skin_offset(grey, grid, inside, board, source)
    return Corners(source, board, grid[inside], index[inside])


def _seed(grey: Array, board: Checkerboard) -> Array | None:
    """Detect a rectangle of corners (rows, columns, 2) px, upright: part of a skin, or a board.

    A skin is searched for in the middle first: under uneven light the finder may skip corners.
    """
    limit = MIN_SKIN_CORNERS if board.skin else max(board.corners)
    min_corners = tuple(min(limit, n) for n in board.corners)
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
    """Remove sides along the edge of the board, which the finder may mistake for inner corners."""
    for side in range(4):
        turned = np.rot90(grid, side)
        if len(turned) > 2 and np.mean(_corners_near(grey, turned[-1], turned[-2])[1]) < 0.5:
            grid = np.rot90(turned[:-1], -side)
    return np.ascontiguousarray(grid)


def _squares(grey: Array, grid: Array, inside: Array) -> tuple[Array, Array, Array]:
    """Return, per square between corners (rows - 1, columns - 1): grey level, mask of squares with
    all four corners inside, mask of an even sum of column and row."""
    complete = inside[1:, 1:] & inside[:-1, 1:] & inside[1:, :-1] & inside[:-1, :-1]
    middles = (grid[1:, 1:] + grid[:-1, 1:] + grid[1:, :-1] + grid[:-1, :-1]) / 4
    xy = np.rint(np.where(complete[..., None], middles, 0)).astype(int)
    rows, columns = complete.shape
    even = (np.arange(rows)[:, None] + np.arange(columns)) % 2 == 0
    return (cv2.blur(grey, (3, 3))[xy[..., 1], xy[..., 0]].astype(float), complete, even)


def _is_alternating(grey: Array, grid: Array) -> bool:
    """True if the squares between corners alternate dark and light, so that none was skipped."""
    values, complete, even = _squares(grey, grid, _inside(grey, grid))
    sign = np.where(even, 1, -1)
    right = (np.diff(values, axis=1) * sign[:, 1:])[complete[:, 1:] & complete[:, :-1]]
    down = (np.diff(values, axis=0) * sign[1:])[complete[1:] & complete[:-1]]
    steps = np.concatenate((right, down))
    steps *= np.sign(np.median(steps)) if len(steps) else 1.0
    return len(steps) > 0 and bool(np.mean(steps > 0) > ALTERNATING_SHARE)


def _turn_upright(grid: Array) -> Array:
    """Turn the rectangle (rows, columns, 2) px so that columns run to +x and rows to +y."""
    along = np.diff(grid, axis=1).mean((0, 1))
    if abs(along[0]) < abs(along[1]):
        grid = grid.transpose(1, 0, 2)
    if np.diff(grid, axis=1).mean((0, 1))[0] < 0:
        grid = grid[:, ::-1]
    if np.diff(grid, axis=0).mean((0, 1))[1] < 0:
        grid = grid[::-1]
    return np.ascontiguousarray(grid)


def _inside(grey: Array, grid: Array) -> NDArray[np.bool_]:
    """True for corners well inside the image; the finder also guesses some beyond its border."""
    limits = np.array(grey.shape[::-1]) - 1 - CORNER_BORDER_PX
    return np.asarray(np.all((grid >= CORNER_BORDER_PX) & (grid <= limits), axis=-1))


def _grow_grid(
    grey: Array, grid: Array, inside: Array, board: Checkerboard
) -> tuple[Array, NDArray[np.bool_]]:
    """Extend the rectangle over all corners around it; return it and the mask of visible corners.

    Each side is extrapolated by the parabola of its last three corners until none is found.
    """
    max_size = board.corners[::-1]
    sides = [0, 1, 2, 3]
    while sides:
        for side in tuple(sides):
            # Turn the side to be extended to the last row.
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
    """Find corners (n, 2) near guesses (n, 2) px of a row, and the mask of those present.

    inner: the adjacent row. In a corner two dark squares meet two light ones.
    """
    corners = guess.copy()
    inside = _inside(grey, guess)
    out, along = guess - inner, np.gradient(guess, axis=0)
    pitch = np.minimum(np.linalg.norm(out, axis=1), np.linalg.norm(along, axis=1))
    for k in np.flatnonzero(inside):
        half = int(np.clip(np.rint(REFINE_SHARE * pitch[k]), *REFINE_LIMITS_PX))
        start = guess[k].astype(np.float32).reshape(1, 1, 2)
        new = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), _REFINE_STOP).reshape(2)
        inside[k] = np.linalg.norm(new - guess[k]) < REFINE_SHARE * pitch[k]
        if inside[k]:
            corners[k] = new
    squares = [corners + REFINE_SHARE * (a * out + b * along) for a in (-1, 1) for b in (-1, 1)]
    last = np.array(grey.shape[::-1]) - 1
    samples = [np.rint(np.clip(square, 0, last)).astype(int) for square in squares]
    first, second, third, fourth = (grey[p[:, 1], p[:, 0]].astype(float) for p in samples)
    low, high = np.minimum(first, fourth), np.maximum(first, fourth)
    contrast = np.maximum(low - np.maximum(second, third), np.minimum(second, third) - high)
    spread = np.maximum(high - low, np.abs(second - third))
    return corners, np.asarray(inside & (contrast > np.maximum(MIN_CORNER_CONTRAST, spread)))


def _refine_corners(grey: Array, grid: Array, inside: Array) -> Array:
    """Refine each corner in a window as large as its neighbours allow."""
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
    half_px = np.clip(np.rint(REFINE_SHARE * nearest_px), *REFINE_LIMITS_PX).astype(int)
    refined = grid.copy()
    for half in np.unique(half_px[inside]):
        selected = (half_px == half) & inside
        start = grid[selected].astype(np.float32).reshape(-1, 1, 2)
        window = (int(half), int(half))
        new = cv2.cornerSubPix(grey, start, window, (-1, -1), _REFINE_STOP).reshape(-1, 2)
        # A corner that moves too far has found something else.
        stays = np.linalg.norm(new - grid[selected], axis=1) < half / 2
        refined[selected] = np.where(stays[:, None], new, grid[selected])
    return refined


def _skin_offset(
    grey: Array, grid: Array, inside: Array, board: Checkerboard, source: str
) -> NDArray[np.int64]:
    """Find the offset of (column, row) in the rectangle to those of the skin. Raises InputError."""
    rows, columns = grid.shape[:2]
    middle_px = (np.array(grey.shape[::-1]) - 1) / 2
    # Position of the guessed origin in the rectangle, by an affine map of the nearest corners
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
            f"{source}: colours of the squares do not match: another board, or a negative"
        )
    off_mm = np.linalg.norm(guess + shifts - half, axis=1) * board.square_mm
    order = np.argsort(off_mm, kind="stable")
    if len(order) > 1 and off_mm[order[0]] > CLEAR_MIDDLE_RATIO * off_mm[order[1]]:
        raise InputError(
            f"{source}: the skin's middle is {off_mm[order[0]]:.2f} mm off the image's, too far to "
            "identify the square: centre the skin and the camera"
        )
    return np.asarray(shifts[order[0]])
