"""Dot markers: positions of a grid's dots, their CSV for trackers, and drawing."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field, InputError

from .recipe import DotGrid

# By hand, for rounding: a view is pixels times mm per pixel, a disc that touches its edge is inside
VIEW_SLACK_MM = 1e-9


def to_px(xy_mm: Field, mm_per_px: float, size_px: tuple[int, ...]) -> Field:
    """Convert (..., 2) mm to (x, y) px of a centred image of size_px (h, w); 0: pixel centre."""
    height_px, width_px = size_px
    return xy_mm / mm_per_px + np.array([(width_px - 1) / 2, (height_px - 1) / 2])


def check_inside(grid: DotGrid, view_mm: tuple[float, float]) -> None:
    """Raise InputError unless every disc lies in a centred view (x, y)."""
    for axis, line, half_mm, offset_mm, side_mm in zip(
        "xy", ("columns", "rows"), grid.half_mm, grid.offset_mm, view_mm, strict=True
    ):
        reach_mm = half_mm + abs(offset_mm)
        if reach_mm > side_mm / 2 + VIEW_SLACK_MM:
            raise InputError(
                f"dots: along {axis} they reach {reach_mm:g} mm from the middle, the camera sees "
                f"{np.floor(side_mm * 50) / 100:g} mm; reduce {line}, pitch_{axis}_mm, diameter_mm "
                f"or offset_{axis}_mm"
            )


def centres_csv(grid: DotGrid, mm_per_px: float, size_px: tuple[int, int]) -> bytes:
    """Return the dots as CSV in the order of `centres_mm`, positions to a nanometre.

    x_px, y_px: centres in an image of size_px (h, w).
    """
    columns = ["index", "row", "col", "x_mm", "y_mm", "diameter_mm", "x_px", "y_px"]
    xy_mm = grid.centres_mm()
    places = np.hstack((xy_mm, to_px(xy_mm, mm_per_px, size_px)))
    lines = [",".join(columns)]
    for index, place in enumerate(places):
        row, column = divmod(index, grid.columns)
        # + 0.0 turns -0.0 into 0.0
        x_mm, y_mm, *px = (f"{round(value, 6) + 0.0:.6f}" for value in place)
        fields = [str(index), str(row), str(column), x_mm, y_mm, f"{grid.diameter_mm:.6f}", *px]
        lines.append(",".join(fields))
    return ("\n".join(lines) + "\n").encode()


def blend(image: NDArray[np.float32], grid: DotGrid, mm_per_px: float, colour: Field) -> None:
    """Blend the dots into a centred float image (h, w, 3), in place, by covered area.

    colour: (3,) in the image's units. Exact along x, 16 chords per pixel along y.
    """
    radius_mm = grid.diameter_mm / 2
    chords = (np.arange(16) + 0.5) / 16 - 0.5
    for centre in grid.centres_mm():
        at_px = to_px(centre, mm_per_px, image.shape[:2])
        (columns, dx_mm), (rows, dy_mm) = (
            covered_px(n, centre_px, radius_mm, mm_per_px)
            for n, centre_px in zip(image.shape[1::-1], at_px, strict=True)
        )
        rise_mm = dy_mm[:, None] + chords * mm_per_px
        half_mm = np.sqrt(np.maximum(radius_mm**2 - rise_mm**2, 0.0))[..., None]
        right_mm = np.minimum(dx_mm + mm_per_px / 2, half_mm)
        left_mm = np.maximum(dx_mm - mm_per_px / 2, -half_mm)
        covered = np.maximum(right_mm - left_mm, 0.0).mean(axis=1)[..., None] / mm_per_px
        image[rows, columns] = image[rows, columns] * (1 - covered) + colour * covered


def covered_px(length: int, at_px: float, radius_mm: float, pitch_mm: float) -> tuple[slice, Field]:
    """Pixels along one axis that a disc at at_px may cover, and their distances from it, mm."""
    reach_px = radius_mm / pitch_mm + 1
    first = max(0, math.floor(at_px - reach_px))
    stop = max(first, min(length, math.ceil(at_px + reach_px) + 1))
    return slice(first, stop), (np.arange(first, stop, dtype=float) - at_px) * pitch_mm
