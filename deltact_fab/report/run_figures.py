"""Figures of one run: tracking errors, the shape at the deepest presses, and the force."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..analysis.measured import FORCE, DeepestPress
from . import figures
from .figures import (
    BAND,
    COLOURS,
    PAPER_COLOUR,
    SOFT,
    blank,
    legend_below,
    log_ticks,
    mark_legs,
    name_marks,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..analysis.tracking_error import TrackingVerdict


ARROW_BGR = (90, 235, 255)


def by_step(
    frames: pd.DataFrame, methods: Sequence[str], column: str, words: str, log: bool = True
) -> Figure:
    """A column of the table of frames against the frame, a panel an indenter."""
    indenters = list(dict.fromkeys(frames["indenter"]))
    figure, axes = blank(9.6, 3.6, len(indenters))
    for axis, indenter in zip(axes, indenters, strict=True):
        part = frames[frames["indenter"] == indenter]
        for colour, name in zip(cycle(COLOURS), methods, strict=False):
            rows = part[part["method"] == name].sort_values("seq")
            index = np.arange(1, len(rows) + 1)
            axis.plot(index, rows[column].astype(float), color=colour, lw=1.4, label=name,
                      ls="-" if "/" not in name else "--")  # fmt: skip
        mark_legs(axis, part[part["method"] == methods[0]].sort_values("seq"))
        axis.set_xlabel("frame")
        axis.set_title(indenter, loc="left", fontweight="bold")
    axes[0].set_ylabel(words)
    if log:
        log_ticks(axes[0], "y")
    # Room for the names of the legs.
    low, high = axes[0].get_ylim()
    axes[0].set_ylim(low, high * (high / low) ** 0.15 if log else high + 0.15 * (high - low))
    legend_below(figure, axes[-1])
    return figure


def error_by_time(
    methods: Sequence[dict[str, Any]], verdict: TrackingVerdict, paper_mm: float, simulated: bool
) -> Figure | None:
    """Error against CPU time a frame, one mark a method, and the front of those to be believed.

    None without any error.
    """
    error = verdict.error
    if error is None:
        return None
    rows = [row for row in methods if row[error] is not None]
    figure, (axis,) = blank(9.6, 4.2)
    at_front = {row["name"]: row for row in rows if row["name"] in verdict.front}
    front = [at_front[name] for name in verdict.front]
    times = [row["cpu_ms"]["p50"] for row in rows]
    left_ms, right_ms = min(times) / 1.6, max(times) * 2.2
    if front:
        # Down and to the right in steps: what each time buys.
        x = [row["cpu_ms"]["p50"] for row in front]
        y = [row[error] for row in front]
        axis.step([*x, right_ms], [*y, y[-1]], where="post", color=BAND, lw=5, zorder=0,
                  label="the front: no other one beats it in both")  # fmt: skip
    names = []
    for colour, row in zip(cycle(COLOURS), methods, strict=False):
        if row not in rows:
            continue
        x_ms, y_mm = row["cpu_ms"]["p50"], row[error]
        believed = not verdict.doubts[row["name"]]
        axis.plot(x_ms, y_mm, "o" if believed else "x", color=colour, ms=8, mew=1.8)
        at_dots = row["mean_at_dots_mm"]
        if at_dots is not None and error != "mean_at_dots_mm":
            axis.plot(x_ms, at_dots, "s", color=colour, mfc="none", ms=6, mew=1.2)
        names.append((x_ms, y_mm, row["name"], colour))
    axis.axhline(paper_mm, color=PAPER_COLOUR, lw=1.2, ls=":",
                 label=f"paper, at the dots, real sensor: {paper_mm} mm")  # fmt: skip
    log_ticks(axis, "xy")
    axis.set_xlim(left_ms, right_ms)
    axis.set_xlabel("CPU time a frame, ms: median, one thread")
    axis.set_ylabel(f"mean error, mm{', simulated' if simulated else ''}")
    for marker, face, words in (
        ("o", SOFT, f"{verdict.error_words}, can be believed"),
        ("x", SOFT, "cannot be believed"),
        ("s", "none", "at the dots"),
    ):
        axis.plot([], [], marker, color=SOFT, mfc=face, label=words)
    legend_below(figure, axis)
    name_marks(figure, axis, names, verdict.take or "")
    return figure


def error_by_indenter(
    rows: Sequence[dict[str, Any]], verdict: TrackingVerdict, paper_mm: float
) -> Figure | None:
    """Bars a method, grouped by indenter, of the error that was judged; None without any."""
    error = verdict.error
    if error is None:
        return None
    indenters = list(dict.fromkeys(r["indenter"] for r in rows))
    names = list(dict.fromkeys(r["name"] for r in rows))
    found = {(r["name"], r["indenter"]): r[error] for r in rows}
    figure, (axis,) = blank(9.6, 3.6)
    width = 0.8 / len(names)
    for i, (name, colour) in enumerate(zip(names, cycle(COLOURS), strict=False)):
        known = [(k, found[name, n]) for k, n in enumerate(indenters) if found[name, n] is not None]
        at = np.array([k for k, _ in known]) + (i - (len(names) - 1) / 2) * width
        axis.bar(at, [v for _, v in known], width * 0.9, color=colour, label=name)
        for x, (_, value) in zip(at, known, strict=True):
            axis.text(x, value, f"{value:.2g}", ha="center", va="bottom", fontsize=7.5)
    axis.axhline(
        paper_mm, color=PAPER_COLOUR, lw=1.2, ls=":", label=f"paper: {paper_mm} mm, at dots"
    )
    axis.set_xticks(np.arange(len(indenters)), indenters)
    axis.set_ylabel(f"mean error, mm ({verdict.error_words})")
    axis.grid(axis="x", visible=False)
    legend_below(figure, axis)
    return figure


def flow_picture(
    image: NDArray[np.uint8], arrows: NDArray[np.float32], step_px: int, gain: float
) -> NDArray[np.uint8]:
    """(h, w, 3) BGR with the flow drawn as arrows, `gain` times as long as the motion."""
    import cv2

    out = (image * 0.5).astype(np.uint8)
    half = step_px // 2
    for i in range(arrows.shape[0]):
        for j in range(arrows.shape[1]):
            u, v = (float(c) for c in arrows[i, j])
            if u * u + v * v < 0.25:
                continue
            x, y = half + j * step_px, half + i * step_px
            tip = (round((x + gain * u) * 8), round((y + gain * v) * 8))
            cv2.arrowedLine(out, (x * 8, y * 8), tip, ARROW_BGR, 2, cv2.LINE_AA, 3, 0.3)
    return out


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
