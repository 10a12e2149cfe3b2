"""Figures of what was measured of a run: the shape at the deepest presses, and the force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis.measured import FORCE, DeepestPress, Force
from . import figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ARROW_MM = 1.5
MIN_MM = 0.05
SHOWN_MAP = "magma"


def deepest_presses(presses: Sequence[DeepestPress]) -> Figure:
    """A panel an indenter: shape or pressure as a map, flow or shear as arrows, contact in white.

    As the paper's figure of the force distribution has it.
    """
    from matplotlib import colormaps

    columns = min(3, len(presses))
    rows = -(-len(presses) // columns)
    high = rows * (0.9 + 4.8 / columns)
    figure, axes = figures.blank(9.6, high, columns, share_y=False, rows=rows)
    colours = colormaps[SHOWN_MAP].resampled(64).with_extremes(bad="#8a8f99")
    for axis in axes[len(presses) :]:
        axis.set_visible(False)
    for press, axis in zip(presses, axes, strict=False):
        _panel(figure, axis, press, colours)
    return figure


def _panel(figure: Figure, axis: Axes, press: DeepestPress, colours: Any) -> None:
    flow, found = press.result.flow, press.result.shape
    assert flow is not None, "all that can be measured is"
    assert found is not None, "all that can be measured is"
    depth = found.depth
    half = flow.cell_mm / 2
    edges = (flow.x_mm[0] - half, flow.x_mm[-1] + half, flow.y_mm[-1] + half, flow.y_mm[0] - half)
    if depth is None:
        shape = np.ma.masked_array(found.relative, ~found.density.reliable)
    else:
        shape = np.ma.masked_array(depth.depth_mm, ~depth.known)
    top = max(float(shape.max()) if shape.count() else 0.0, MIN_MM)
    drawn = axis.imshow(shape, cmap=colours, vmin=0, vmax=top, extent=edges)
    words = "relative depth" if depth is None else "depth, mm"
    bar = figure.colorbar(drawn, ax=axis, label=words, shrink=0.55)
    assert bar.solids is not None, "of a map"
    bar.solids.set_rasterized(False)  # as an image it would have the id of any other panel's
    every = max(1, round(ARROW_MM / flow.cell_mm))
    at = np.ix_(range(every // 2, len(flow.y_mm), every), range(every // 2, len(flow.x_mm), every))
    u, v = (np.ma.masked_array(flow.shift_mm[..., k][at], ~flow.known[at]) for k in (0, 1))
    x, y = np.meshgrid(flow.x_mm[at[1][0]], flow.y_mm[at[0][:, 0]])
    most = max(float(np.hypot(u, v).max()) if u.count() else 0.0, MIN_MM)
    axis.quiver(x, y, u, v, color="#7fe0ff", angles="xy", scale_units="xy",
                scale=most / (1.6 * ARROW_MM), width=0.005)  # fmt: skip
    for contact in press.result.contacts or ():
        axis.plot(*np.vstack((contact.outline_mm, contact.outline_mm[:1])).T, color="white", lw=1.4)
    axis.set_title(f"{press.indenter}, {press.depth_mm:.2f} mm", loc="left", fontweight="bold")
    axis.set_xlabel(f"x, mm; arrows at most {most:.2f} mm")
    axis.set_ylabel("y, mm")
    axis.grid(False)


def force_traces(force: Force) -> Figure:
    """Measured force, thin and dark, under what the flow says of it; a panel an indenter."""
    table = force.frames
    indenters = list(dict.fromkeys(table["indenter"]))
    figure, axes = figures.blank(9.6, 3.4, len(indenters))
    for axis, indenter in zip(axes, indenters, strict=True):
        part = table[table["indenter"] == indenter].reset_index(drop=True)
        index = np.arange(len(part))
        for colour, column, label in zip(
            figures.COLOURS, FORCE, ("$F_x$", "$F_y$", "$F_z$"), strict=False
        ):
            axis.plot(index, part[column], color=colour, lw=4, alpha=0.4)
            axis.plot(index, part[f"{column}_est"], color=colour, lw=1.2, label=label)
        axis.plot([], [], color=figures.SOFT, lw=4, alpha=0.4, label="force sensor")
        beyond = index[(part["extrapolated"] | ~part["trusted"]).to_numpy()]
        axis.plot([], [], "|", color=figures.DOUBT_COLOUR, ms=9, label="not to be trusted")
        for at in beyond:  # an empty plot off the axes would leave no room for them
            axis.plot(at, 0, "|", color=figures.DOUBT_COLOUR, ms=9, clip_on=False,
                      transform=axis.get_xaxis_transform())  # fmt: skip
        figures.mark_legs(axis, part)
        axis.set_title(indenter, loc="left", fontweight="bold")
        axis.set_xlabel("frame")
    axes[0].set_ylabel("force on the sensor, N")
    figures.legend_below(figure, axes[-1])
    return figure
