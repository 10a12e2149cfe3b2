"""Dot markers: where the dots of a grid are, and their list for whoever tracks them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..aliases import Points
from ..errors import InputError
from .recipe import DotGrid

# A view is given as pixels times mm per pixel: a disc that touches its edge exactly is inside
SLACK_MM = 1e-9


def centres_mm(grid: DotGrid) -> Points:
    """Dot centres in the sensor frame, (rows * columns, 2) mm, about the grid's offset.

    Row by row: index = row * columns + column; row 0 at -y, column 0 at -x.
    """
    x_mm = (np.arange(grid.columns) - (grid.columns - 1) / 2) * grid.pitch_x_mm
    y_mm = (np.arange(grid.rows) - (grid.rows - 1) / 2) * grid.pitch_y_mm
    centred_mm = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    return centred_mm + np.array(grid.offset_mm)


def to_px(xy_mm: Points, mm_per_px: float, size_px: tuple[int, int]) -> Points:
    """Places (..., 2) mm in a centred image of size_px (h, w): (x, y) px, 0 a pixel's centre."""
    height_px, width_px = size_px
    return xy_mm / mm_per_px + np.array([(width_px - 1) / 2, (height_px - 1) / 2])


def check_inside(grid: DotGrid, view_mm: tuple[float, float]) -> None:
    """Raise InputError unless every disc lies wholly in a centred view (x, y) of that size."""
    for axis, half_mm, offset_mm, side_mm, count in zip(
        "xy", grid.half_mm, grid.offset_mm, view_mm, (grid.columns, grid.rows), strict=True
    ):
        if half_mm + abs(offset_mm) > side_mm / 2 + SLACK_MM:
            free_mm = side_mm / 2 - half_mm
            if free_mm >= 0:
                raise InputError(
                    f"dots: offset_{axis}_mm: {offset_mm:g} moves them out of the camera's "
                    f"{side_mm:.2f} mm; at most {np.floor(free_mm * 100) / 100:g} either way"
                )
            room_mm = side_mm - grid.diameter_mm
            largest = (
                f"a pitch_{axis}_mm of at most {np.floor(room_mm / (count - 1) * 100) / 100:g}"
                if count > 1 and room_mm > 0
                else "fewer or smaller dots"
            )
            raise InputError(
                f"dots: {count} along {axis} span {2 * half_mm:g} mm and the camera sees "
                f"{side_mm:.2f} mm; {largest} keeps them in view"
            )


def centres_csv(
    grid: DotGrid, mm_per_px: float | None = None, size_px: tuple[int, int] | None = None
) -> bytes:
    """The dots as CSV, one row a dot in the order of `centres_mm`, positions to a nanometre.

    With an image's mm_per_px and size_px (h, w) two more columns hold the centres in it, in px.
    """
    columns = ["index", "row", "col", "x_mm", "y_mm", "diameter_mm"]
    xy_mm = centres_mm(grid)
    places = xy_mm
    if mm_per_px is not None and size_px is not None:
        columns += ["x_px", "y_px"]
        places = np.hstack((xy_mm, to_px(xy_mm, mm_per_px, size_px)))
    lines = [",".join(columns)]
    for index, place in enumerate(places):
        row, column = divmod(index, grid.columns)
        # + 0.0 turns -0.0 into 0.0
        x_mm, y_mm, *px = (f"{round(value, 6) + 0.0:.6f}" for value in place)
        fields = [str(index), str(row), str(column), x_mm, y_mm, f"{grid.diameter_mm:.6f}", *px]
        lines.append(",".join(fields))
    return ("\n".join(lines) + "\n").encode()


def blend(image: NDArray[np.float32], grid: DotGrid, mm_per_px: float, colour: Points) -> None:
    """Draw the dots into a centred float image (h, w, 3), in place, each pixel by covered area.

    colour: (3,) in the image's units. Exact along x, by 16 chords a pixel along y.
    """
    radius_mm = grid.diameter_mm / 2
    chords = (np.arange(16) + 0.5) / 16 - 0.5
    for centre in centres_mm(grid):
        box, dx_mm, dy_mm = _box(image.shape, centre, radius_mm, mm_per_px)
        rise_mm = dy_mm[:, None] + chords * mm_per_px
        half_mm = np.sqrt(np.maximum(radius_mm**2 - rise_mm**2, 0.0))[..., None]
        right_mm = np.minimum(dx_mm + mm_per_px / 2, half_mm)
        left_mm = np.maximum(dx_mm - mm_per_px / 2, -half_mm)
        covered = np.maximum(right_mm - left_mm, 0.0).mean(axis=1)[..., None] / mm_per_px
        image[box] = image[box] * (1 - covered) + colour * covered


def _box(
    shape: tuple[int, ...], centre: Points, radius_mm: float, mm_per_px: float
) -> tuple[tuple[slice, slice], Points, Points]:
    """The part of a centred image around a disc, and its pixels' x and y from the disc's centre."""
    slices, offsets = [], []
    for length, at_mm in zip((shape[1], shape[0]), centre, strict=True):
        at_px = at_mm / mm_per_px + (length - 1) / 2
        reach_px = radius_mm / mm_per_px + 1
        first = max(0, int(np.floor(at_px - reach_px)))
        stop = max(first, min(length, int(np.ceil(at_px + reach_px)) + 1))
        slices.append(slice(first, stop))
        offsets.append((np.arange(first, stop) - at_px) * mm_per_px)
    return (slices[1], slices[0]), offsets[0], offsets[1]
