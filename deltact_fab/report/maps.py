"""Parts of figures that show maps of the face: around a press, seen as the camera sees it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

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


def window_mm(picture: ShapeMaps) -> tuple[Array, Array]:
    """Limits (low, high) of what is shown in x and in y."""
    left, right, top, bottom = picture.edges_mm
    limits = []
    for at, low, high in zip(picture.tip_mm[:2], (left, top), (right, bottom), strict=True):
        limits.append(np.clip([at - HALF_MM, at + HALF_MM], low, high))
    return limits[0], limits[1]


def frame(axis: Axes, picture: ShapeMaps, first: bool, last: bool) -> None:
    """Limits and labels of a map; first in its row, last in its column."""
    x, y = window_mm(picture)
    axis.grid(visible=False)
    axis.tick_params(labelsize=TICKS)
    for side, low in ((axis.xaxis, x[0]), (axis.yaxis, y[0])):
        side.set_ticks(np.arange(np.ceil(low / 5) * 5, low + 2 * HALF_MM, 5))
    axis.set(xlim=x, ylim=y[::-1], aspect="equal")  # ticks would widen them
    if last:
        axis.set_xlabel("x, mm", fontsize=LABELS)
    if first:
        axis.set_ylabel("y, mm", fontsize=LABELS)


def shown(
    axis: Axes, x_mm: Array, y_mm: Array, values: Array, colours: str, low: float, high: float,
    words: str | None,
) -> Any:  # fmt: skip
    """Values at points, each a cell of its own, with a bar where there are words for it."""
    drawn = axis.pcolormesh(
        x_mm, y_mm, values, cmap=colours, vmin=low, vmax=high, shading="nearest", rasterized=True
    )
    if words is not None:
        bar(axis, drawn, words)
    return drawn


def bar(axis: Axes, drawn: Any, words: str) -> None:
    """What the colours mean."""
    made = axis.figure.colorbar(drawn, ax=axis, shrink=0.8, aspect=16, pad=0.02)
    made.ax.tick_params(labelsize=TICKS)
    made.set_label(words, fontsize=LABELS)
    assert made.solids is not None, "of a map"
    made.solids.set_edgecolor("face")  # no seams
    made.solids.set_rasterized(False)  # as an image it would have the id of any other panel's


def flow(axis: Axes, picture: ShapeMaps) -> float:
    """The camera's image, darkened, with the flow as arrows; the longest of them, mm."""
    rgb = (picture.image[..., ::-1].astype(float) * 0.6).astype(np.uint8)
    left, right, top, bottom = picture.edges_mm
    axis.imshow(rgb, extent=(left, right, bottom, top), interpolation="antialiased")
    size = np.hypot(*np.moveaxis(picture.shift_mm, -1, 0))[picture.known]
    most = float(max(size.max(initial=0), MIN_MM))
    arrows(axis, picture, picture.x_mm, picture.y_mm, picture.shift_mm, picture.known, most)
    return most


def arrows(
    axis: Axes, picture: ShapeMaps, x_mm: Array, y_mm: Array, vectors: Array, known: Array | None,
    most: float,
) -> None:  # fmt: skip
    """Vectors (h, w, 2) at points ARROW_MM apart around the tip; the longest is `most`."""
    from scipy.interpolate import RegularGridInterpolator

    (left, right), (top, bottom) = window_mm(picture)
    middle = picture.tip_mm[:2]
    steps = np.arange(-HALF_MM, HALF_MM + 1e-9, ARROW_MM)
    steps -= steps[len(steps) // 2]  # one arrow at the tip
    x, y = (at + steps for at in middle)
    x = x[(x > max(left, x_mm[0])) & (x < min(right, x_mm[-1]))]
    y = y[(y > max(top, y_mm[0])) & (y < min(bottom, y_mm[-1]))]
    at = np.stack(np.meshgrid(y, x, indexing="ij"), axis=-1)
    part = RegularGridInterpolator((y_mm, x_mm), vectors.astype(float))(at)
    if known is not None:
        sure = RegularGridInterpolator((y_mm, x_mm), known.astype(float), method="nearest")(at)
        part[sure < 0.5] = np.nan
    part[np.hypot(part[..., 0], part[..., 1]) < 0.02 * most] = np.nan
    axis.quiver(
        *np.meshgrid(x, y), part[..., 0], part[..., 1], color=ARROW_COLOUR, angles="xy",
        scale_units="xy", scale=most / (2 * ARROW_MM), width=0.008,
    )  # fmt: skip


def found_contacts(axis: Axes, picture: ShapeMaps, colour: str = "white") -> None:
    """Outlines of the contacts that were found."""
    for outline in picture.outlines_mm:
        axis.plot(*np.vstack((outline, outline[:1])).T, color=colour, lw=1.3)


def true_contact(axis: Axes, picture: ShapeMaps, colour: str, style: str = "--") -> None:
    """Outline of the true contact, where it is known."""
    if picture.true_contact is not None and picture.true_contact.any():
        axis.contour(
            picture.x_mm, picture.y_mm, picture.true_contact.astype(float), [0.5], colors=colour,
            linewidths=1.3, linestyles=style,
        )  # fmt: skip


def solid(figure: Figure, place: Axes) -> Axes3D:
    """Axes in space in the place of flat ones."""
    axis = figure.add_subplot(place.get_subplotspec(), projection="3d")
    place.remove()
    axis.view_init(elev=35, azim=-60)
    axis.tick_params(labelsize=TICKS, pad=-3)
    return axis
