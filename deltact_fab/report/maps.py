"""Parts of figures that show maps of the face: around a press, seen as the camera sees it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..aliases import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

    from ..analysis.shape.picture import ShapeMaps

HALF_MM = 8.0
"""Shown of the face to each side of the tip, as far as the view goes."""
ARROW_MM = 1.5
"""Between arrows: sparse, as the paper's figure of the force distribution has them."""
MIN_MM = 0.02
ARROW_COLOUR = "#7fe0ff"
TICKS, LABELS, HEADS = "x-small", "small", "small"
"""Sizes of letters, of those that the page or the paper has."""

Window = Sequence[Sequence[float] | Array]
"""Limits (low, high) of what is shown in x and in y."""


def window_mm(picture: ShapeMaps) -> Window:
    """What is shown around a press."""
    left, right, top, bottom = picture.edges_mm
    limits = zip(picture.tip_mm[:2], (left, top), (right, bottom), strict=True)
    return [np.clip([at - HALF_MM, at + HALF_MM], low, high) for at, low, high in limits]


def frame(axis: Axes, window: Window, first: bool = True, last: bool = True) -> None:
    """Limits and labels of a map; first in its row, last in its column."""
    from matplotlib.ticker import MultipleLocator

    axis.grid(visible=False)
    axis.tick_params(labelsize=TICKS)
    for side in (axis.xaxis, axis.yaxis):
        side.set_major_locator(MultipleLocator(5))
    axis.set(xlim=window[0], ylim=window[1][::-1], aspect="equal")
    if last:
        axis.set_xlabel("x, mm", fontsize=LABELS)
    if first:
        axis.set_ylabel("y, mm", fontsize=LABELS)


def shown(
    axis: Axes, x_mm: Array, y_mm: Array, values: Array, colours: str, low: float, high: float,
    words: str, side: str = "right",
) -> None:  # fmt: skip
    """Values at points, each a cell of its own, with a bar at a side; those of no number blank."""
    drawn = axis.pcolormesh(
        x_mm, y_mm, values, cmap=colours, vmin=low, vmax=high, shading="nearest", rasterized=True
    )
    bar = axis.figure.colorbar(drawn, ax=axis, location=side, shrink=0.8, aspect=16, pad=0.02)
    bar.ax.tick_params(labelsize=TICKS)
    bar.set_label(words, fontsize=LABELS)
    assert bar.solids is not None, "of a map"
    bar.solids.set_edgecolor("face")  # no seams
    bar.solids.set_rasterized(False)  # as an image it would have the id of any other panel's


def flow(axis: Axes, picture: ShapeMaps) -> None:
    """The camera's image, darkened, with the flow as arrows."""
    rgb = (picture.image[..., ::-1].astype(float) * 0.6).astype(np.uint8)
    left, right, top, bottom = picture.edges_mm
    axis.imshow(rgb, extent=(left, right, bottom, top), interpolation="antialiased")
    known = np.where(picture.known[..., None], picture.shift_mm, np.nan)
    most = arrows(axis, picture.x_mm, picture.y_mm, known, picture.tip_mm)
    axis.set_title(f"flow, at most {most:.2f} mm", fontsize=HEADS)


def arrows(
    axis: Axes, x_mm: Array, y_mm: Array, vectors: Array, middle: Array, most: float | None = None
) -> float:
    """Vectors (h, w, 2), NaN where not known, at points ARROW_MM apart, one in the middle.

    most: the longest, drawn so that arrows do not hide each other; of all where it is not given.
    """
    from scipy.interpolate import RegularGridInterpolator

    if most is None:
        most = float(np.nanmax(np.hypot(vectors[..., 0], vectors[..., 1]), initial=MIN_MM))
    x, y = (
        np.arange(at - ARROW_MM * ((at - side[0]) // ARROW_MM), side[-1], ARROW_MM)
        for side, at in zip((x_mm, y_mm), middle, strict=False)
    )
    at = np.stack(np.meshgrid(y, x, indexing="ij"), axis=-1)
    part = RegularGridInterpolator((y_mm, x_mm), vectors.astype(float))(at)
    part[np.hypot(part[..., 0], part[..., 1]) < 0.02 * most] = np.nan
    axis.quiver(x, y, part[..., 0], part[..., 1], color=ARROW_COLOUR, angles="xy", units="inches",
                scale_units="xy", scale=most / (2 * ARROW_MM), width=0.013)  # fmt: skip
    return most


def outlines(axis: Axes, lines_mm: Iterable[Array], colour: str = "white") -> None:
    """Outlines (n, 2) of contacts."""
    for line_mm in lines_mm:
        axis.plot(*np.vstack((line_mm, line_mm[:1])).T, color=colour, lw=1.3)


def true_contact(axis: Axes, picture: ShapeMaps, colour: str, style: str = "--") -> None:
    """Outline of the true contact, where it is known."""
    if picture.true_contact is not None and picture.true_contact.any():
        axis.contour(
            picture.x_mm, picture.y_mm, picture.true_contact.astype(float), [0.5], colors=colour,
            linewidths=1.3, linestyles=style,
        )  # fmt: skip


def solid(figure: Figure, place: Axes) -> Axes3D:
    """Axes in space in the place of flat ones, which keep their letter."""
    place.set_axis_off()
    axis = figure.add_subplot(place.get_subplotspec(), projection="3d")
    axis.view_init(elev=35, azim=-60)
    axis.tick_params(labelsize=TICKS, pad=-3)
    return axis
