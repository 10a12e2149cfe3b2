"""The shape of each press as the paper's gallery shows it: density, depth with outline, relief."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import figures
from .figures import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..analysis.shape.result import Picture

Array = NDArray[Any]
MOST_PRESSES = 8
RELIEF_MM = 0.6  # between the lines of the relief


def gallery(pictures: Sequence[Picture], note: str) -> Figure:
    """A row a press, the deepest settled frame of each; the first MOST_PRESSES."""
    shown = list(pictures)[:MOST_PRESSES]
    figure, axes = figures.blank(11.0, 3.0 * len(shown) + 0.3, 3, share_y=False, rows=len(shown))
    left = "" if len(shown) == len(pictures) else f"; {len(shown)} of {len(pictures)} presses"
    lines = "white: contact found; dashed: true contact; dotted: as far as the density is reliable"
    figure.suptitle(f"{note}{left}\n{lines}", fontsize=9)
    for k, picture in enumerate(shown):
        flat, deep, relief = axes[3 * k : 3 * k + 3]
        depth = picture.depth
        limit = max(float(np.abs(picture.relative).max()), 0.02)
        flat.set_title(f"{picture.indenter}, {picture.tip_depth_mm:.2f} mm", loc="left",
                       fontweight="bold")  # fmt: skip
        _map(flat, picture, picture.relative, "RdBu_r", (-limit, limit), "minus density, from rest")
        if not picture.reliable.all():
            flat.contour(depth.x_mm, depth.y_mm, picture.reliable, [0.5], colors="#555555",
                         linewidths=0.6, linestyles=":")  # fmt: skip
        top = max(float(depth.depth_mm.max()), 0.02)
        _map(deep, picture, depth.depth_mm, "viridis", (0, top), "depth, mm")
        for outline in picture.outlines_mm:
            closed = np.vstack((outline, outline[:1]))
            deep.plot(*closed.T, color="white", lw=1.4)
        if picture.true_contact is not None and picture.true_contact.any():
            deep.contour(depth.x_mm, depth.y_mm, picture.true_contact, [0.5], colors=COLOURS[4],
                         linewidths=1, linestyles="--")  # fmt: skip
        _relief(figure, relief, picture)
    return figure


def _map(
    axis: Axes,
    picture: Picture,
    values: Array,
    colours: str,
    ends: tuple[float, float],
    words: str,
) -> None:
    x, y = picture.depth.x_mm, picture.depth.y_mm
    # As the camera sees it: row 0 above.
    drawn = axis.imshow(
        values, cmap=colours, vmin=ends[0], vmax=ends[1], interpolation="nearest",
        extent=(x[0], x[-1], y[-1], y[0]),
    )  # fmt: skip
    axis.grid(visible=False)
    axis.set_xlabel("x, mm")
    axis.set_ylabel("y, mm")
    axis.figure.colorbar(drawn, ax=axis, shrink=0.8, label=words)


def _relief(figure: Figure, place: Axes, picture: Picture) -> None:
    """The face seen from the side, pressed downwards."""
    depth = picture.depth
    axis = figure.add_subplot(place.get_subplotspec(), projection="3d")
    place.remove()
    every = max(1, round(RELIEF_MM / depth.cell_mm))
    x, y = np.meshgrid(depth.x_mm[::every], depth.y_mm[::every])
    z = -depth.depth_mm[::every, ::every]
    axis.plot_surface(x, y, z, cmap="viridis_r", rstride=1, cstride=1, linewidth=0.15,
                      edgecolor="#33333366")  # fmt: skip
    axis.set_box_aspect((np.ptp(x), np.ptp(y), 9), zoom=0.95)
    axis.view_init(elev=38, azim=-60)
    low = min(-0.1, float(z.min()))
    axis.set_zlim(low, 0)
    axis.set_zticks([0, round(low, 1)])
    axis.tick_params(labelsize=7, pad=-3)
