"""Figures of one run: tracking errors, the shape at the deepest presses, and the force."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from ..analysis.measured import FORCE, DeepestPress
from ..analysis.tracking_error import PAPER_BEST_MM
from . import figures, maps
from .figures import COLOURS, PAPER_COLOUR, SOFT, blank, legend_below, log_ticks, mark_legs

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..analysis.tracking_error import TrackingResult


def error_by_step(tracking: TrackingResult) -> Figure | None:
    """The error that was judged against the frame, a panel an indenter; None without any."""
    frames, error = tracking.frames, tracking.verdict.error
    if error is None:
        return None
    names = [row["name"] for row in tracking.methods]
    indenters = list(dict.fromkeys(frames["indenter"]))
    figure, axes = blank(9.6, 3.6, len(indenters))
    for axis, indenter in zip(axes, indenters, strict=True):
        part = frames[frames["indenter"] == indenter]
        for colour, name in zip(cycle(COLOURS), names, strict=False):
            rows = part[part["method"] == name].sort_values("seq")
            index = np.arange(1, len(rows) + 1)
            axis.plot(index, rows[error].astype(float), color=colour, lw=1.4, label=name,
                      ls="-" if "/" not in name else "--")  # fmt: skip
        mark_legs(axis, part[part["method"] == names[0]].sort_values("seq"))
        axis.set_xlabel("frame")
        axis.set_title(indenter, loc="left", fontweight="bold")
    axes[0].set_ylabel(f"mean error, mm\n({tracking.verdict.error_words})")
    log_ticks(axes[0], "y")
    low, high = axes[0].get_ylim()
    axes[0].set_ylim(low, high * (high / low) ** 0.15)  # room for the names of the legs
    legend_below(figure, axes[-1])
    return figure


def error_by_time(tracking: TrackingResult) -> Figure | None:
    """Error against CPU time a frame, one mark a method; None without any error."""
    verdict = tracking.verdict
    error = verdict.error
    if error is None:
        return None
    rows = [row for row in tracking.methods if row[error] is not None]
    figure, (axis,) = blank(9.6, 4.2)
    names = []
    for colour, row in zip(cycle(COLOURS), rows, strict=False):
        x_ms, name = row["ms_per_frame"], row["name"]
        mark = "x" if verdict.doubts[name] else "o"
        axis.plot(x_ms, row[error], mark, color=colour, ms=8, mew=1.8)
        at_dots = row["mean_at_dots_mm"]
        if at_dots is not None and error != "mean_at_dots_mm":
            axis.plot(x_ms, at_dots, "s", color=colour, mfc="none", ms=6, mew=1.2)
        names.append((x_ms, row[error], name, colour))
    axis.axhline(PAPER_BEST_MM, color=PAPER_COLOUR, lw=1.2, ls=":",
                 label=f"paper, at the dots, real sensor: {PAPER_BEST_MM} mm")  # fmt: skip
    log_ticks(axis, "xy")
    times = [row["ms_per_frame"] for row in rows]
    axis.set_xlim(min(times) / 1.6, max(times) * 2.2)
    axis.set_xlabel("CPU time a frame, ms: median, one thread")
    axis.set_ylabel(f"mean error, mm{', simulated' if tracking.simulated else ''}")
    for marker, face, words in (
        ("o", SOFT, f"{verdict.error_words}, can be believed"),
        ("x", SOFT, "cannot be believed"),
        ("s", "none", "at the dots"),
    ):
        axis.plot([], [], marker, color=SOFT, mfc=face, label=words)
    legend_below(figure, axis)
    figures.name_marks(figure, axis, names, verdict.take or "")
    return figure


def deepest_presses(presses: Sequence[DeepestPress]) -> Figure:
    """A panel an indenter: depth as a map, flow as arrows, contact in white."""
    columns = min(3, len(presses))
    rows = -(-len(presses) // columns)
    high = rows * (0.9 + 4.8 / columns)
    figure, axes = blank(9.6, high, columns, share_y=False, rows=rows)
    for axis in axes[len(presses) :]:
        axis.set_visible(False)
    for press, axis in zip(presses, axes, strict=False):
        _panel(axis, press)
    return figure


def _panel(axis: Axes, press: DeepestPress) -> None:
    flow, found = press.result.flow, press.result.shape
    assert flow is not None, "all that can be measured is"
    assert found is not None, "all that can be measured is"
    if found.depth is None:
        shape, words = np.where(found.density.reliable, found.relative, np.nan), "relative depth"
    else:
        shape, words = np.where(found.depth.known, found.depth.depth_mm, np.nan), "depth, mm"
    axis.set_facecolor("#8a8f99")  # where nothing is known
    top = np.nanmax(shape, initial=2 * maps.MIN_MM)
    maps.shown(axis, found.x_mm, found.y_mm, np.ma.masked_invalid(shape), "magma", 0, top, words)
    every = max(1, round(maps.ARROW_MM / flow.cell_mm))
    part = np.s_[every // 2 :: every, every // 2 :: every]
    u, v = np.moveaxis(np.where(flow.known[..., None], flow.shift_mm, np.nan)[part], -1, 0)
    most = np.nanmax(np.hypot(u, v), initial=2 * maps.MIN_MM)
    x, y = np.meshgrid(flow.x_mm, flow.y_mm)
    axis.quiver(x[part], y[part], u, v, color=maps.ARROW_COLOUR, angles="xy", scale_units="xy",
                scale=most / (1.6 * maps.ARROW_MM), width=0.005)  # fmt: skip
    for contact in press.result.contacts or ():
        axis.plot(*np.vstack((contact.outline_mm, contact.outline_mm[:1])).T, color="white", lw=1.4)
    axis.set_title(f"{press.indenter}, {press.depth_mm:.2f} mm", loc="left", fontweight="bold")
    axis.set_xlabel(f"x, mm; arrows at most {most:.2f} mm")
    axis.set_ylabel("y, mm")
    axis.set_aspect("equal")
    axis.invert_yaxis()
    axis.grid(False)


def force_and_motion(t_s: pd.Series[float], frames: pd.DataFrame, moved_px: list[float]) -> Figure:
    """Of an imported run, over time: force on the sensor, and how far the picture moved."""
    known = [name for name in FORCE if frames[name].notna().any()]
    figure, axes = blank(9.6, 3.4, 2 if known else 1, share_y=False)
    for axis in axes:
        axis.set_xlabel("time since the first image, s")
    for colour, name in zip(COLOURS, known, strict=False):
        axes[0].plot(t_s, frames[name], color=colour, lw=1.2, label=f"$F_{name[1]}$")
    if known:
        axes[0].set_ylabel("force on the sensor, N")
        legend_below(figure, axes[0])
    axes[-1].plot(t_s, moved_px, color=SOFT, lw=1.2)
    axes[-1].set_ylabel("mean motion of the picture, px")
    return figure


def force_by_frame(frames: pd.DataFrame) -> Figure:
    """Force on the sensor against the frame, a panel an indenter.

    Where the flow was asked (columns of `Force.frames`), what was measured lies thick and pale
    under what the flow says of it.
    """
    indenters = list(dict.fromkeys(frames["indenter"]))
    estimated = f"{FORCE[0]}_est" in frames
    figure, axes = blank(9.6, 3.4, len(indenters))
    for axis, indenter in zip(axes, indenters, strict=True):
        part = frames[frames["indenter"] == indenter].reset_index(drop=True)
        index = np.arange(len(part))
        for colour, column, label in zip(COLOURS, FORCE, ("$F_x$", "$F_y$", "$F_z$"), strict=False):
            if estimated:
                axis.plot(index, part[column], color=colour, lw=4, alpha=0.4)
            shown = part[f"{column}_est" if estimated else column]
            axis.plot(index, shown, color=colour, lw=1.2, label=label)
        if estimated:
            axis.plot([], [], color=SOFT, lw=4, alpha=0.4, label="force sensor")
            axis.plot([], [], "|", color=figures.DOUBT_COLOUR, ms=9, label="not to be trusted")
            beyond = index[(part["extrapolated"] | ~part["trusted"]).to_numpy()]
            for at in beyond:  # an empty plot off the axes would leave no room for them
                axis.plot(at, 0, "|", color=figures.DOUBT_COLOUR, ms=9, clip_on=False,
                          transform=axis.get_xaxis_transform())  # fmt: skip
        mark_legs(axis, part)
        axis.set_title(indenter, loc="left", fontweight="bold")
        axis.set_xlabel("frame")
    axes[0].set_ylabel("force on the sensor, N")
    legend_below(figure, axes[-1])
    return figure
