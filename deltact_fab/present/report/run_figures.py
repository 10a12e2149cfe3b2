"""Figures of runs: tracking errors, shape at the deepest presses, force and its calibration."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from deltact_fab.estimate import DeepestPress, ForceResult, RunMeasurement

from . import figures
from . import shape_figures as maps
from .figures import SERIES_COLOURS, SOFT_COLOUR, draw_legend, label_frames, set_log_scale
from .result import ReportFigure

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from deltact_fab.estimate import TrackingResult

MAX_METHODS = 4  # by hand: more curves hide each other


def _plotted_methods(tracking: TrackingResult) -> list[tuple[str, dict[str, Any]]]:
    """Methods with a known error and their colours, MAX_METHODS at most; the table has all.

    First the recommended, the paper's, the fastest and the most accurate.
    """
    verdict = tracking.verdict
    rated = [m for m in tracking.methods if verdict.error and m[verdict.error] is not None]
    ranks = (
        lambda m: m["name"] != verdict.take,
        lambda m: not m["name"].startswith("paper"),
        lambda m: m["ms_per_frame"],
        lambda m: m[verdict.error],
    )
    first = [min(rated, key=rank)["name"] for rank in ranks if rated]
    names = list(dict.fromkeys(first + [m["name"] for m in rated]))[:MAX_METHODS]
    return list(zip(SERIES_COLOURS, (m for m in rated if m["name"] in names), strict=False))


def plot_error_by_step(tracking: TrackingResult) -> Figure | None:
    """Plot the verdict's error against the frame, a panel per indenter; None without any."""
    frames, error, methods = tracking.frames, tracking.verdict.error, _plotted_methods(tracking)
    if not methods:
        return None
    indenters = list(dict.fromkeys(frames["indenter"]))
    figure, axes = figures.create_panels(len(indenters), 3.6)
    for axis, indenter in zip(axes, indenters, strict=True):
        part = frames[frames["indenter"] == indenter].sort_values("seq")
        for colour, method in methods:
            rows = part[part["method"] == method["name"]]
            axis.plot(np.arange(1, len(rows) + 1), rows[error].astype(float), color=colour, lw=1.4,
                      label=method["name"], ls="--" if "/" in method["name"] else "-")  # fmt: skip
        label_frames(axis, part[part["method"] == tracking.methods[0]["name"]]["step_id"])
        axis.set_title(indenter, loc="left", fontweight="bold")
    axes[0].set_ylabel(f"mean error, mm\n({tracking.verdict.error_words})")
    set_log_scale(axes[0], "y")
    draw_legend(figure, axes[-1])
    return figure


def plot_error_by_time(tracking: TrackingResult) -> Figure | None:
    """Plot error against CPU time per frame, a mark per method; None without any error."""
    verdict, methods = tracking.verdict, _plotted_methods(tracking)
    if not methods:
        return None
    error = str(verdict.error)
    figure, (axis,) = figures.create_figure(9.6, 4.2)
    names = []
    for colour, row in methods:
        x_ms, name = row["ms_per_frame"], row["name"]
        mark = "x" if verdict.doubts[name] else "o"
        axis.plot(x_ms, row[error], mark, color=colour, ms=8, mew=1.8)
        at_dots = row["mean_at_dots_mm"]
        if at_dots is not None and error != "mean_at_dots_mm":
            axis.plot(x_ms, at_dots, "s", color=colour, mfc="none", ms=6, mew=1.2)
        names.append((x_ms, row[error], name, colour))
    paper_mm, most_mm = tracking.PAPER_BEST_MM, max(row[error] for _, row in methods)
    words = f"paper, at the dots, real sensor: {paper_mm} mm"
    figures.draw_paper_line(axis, paper_mm, most_mm, words)
    set_log_scale(axis, "xy")
    times = [row["ms_per_frame"] for _, row in methods]
    axis.set_xlim(min(times) / 1.6, max(times) * 2.2)
    axis.set_xlabel("CPU time per frame, ms: median, one thread")
    axis.set_ylabel(f"mean error, mm{', simulated' if tracking.simulated else ''}")
    for marker, face, words in (
        ("o", SOFT_COLOUR, f"{verdict.error_words}, reliable"),
        ("x", SOFT_COLOUR, "not reliable"),
        ("s", "none", "at the dots"),
    ):
        axis.plot([], [], marker, color=SOFT_COLOUR, mfc=face, label=words)
    draw_legend(figure, axis)
    figures.name_marks(figure, axis, names, verdict.take or "")
    return figure


def plot_deepest_presses(presses: Sequence[DeepestPress]) -> Figure:
    """Plot a panel per indenter: depth map, flow arrows, contact in white."""
    figure, axes = figures.create_panels(
        len(presses), 0.9 + 4.8 / min(figures.PANELS_PER_ROW, len(presses)), False
    )
    for press, axis in zip(presses, axes, strict=True):
        _panel(axis, press)
    return figure


def _panel(axis: Axes, press: DeepestPress) -> None:
    flow, shape = press.result.flow, press.result.shape
    assert flow is not None, "all measurable results are present"
    assert shape is not None, "all measurable results are present"
    if shape.depth is None:
        values, words = np.where(shape.density.reliable, shape.relative, np.nan), "relative depth"
    else:
        values, words = np.where(shape.depth.valid, shape.depth.depth_mm, np.nan), "depth, mm"
    axis.set_facecolor("#8a8f99")  # unknown values
    top = float(np.nanmax(values, initial=2 * maps.MIN_ARROW_MM))
    maps.draw_map(axis, shape.x_mm, shape.y_mm, values, "magma", 0, top, words)
    shift_mm = np.where(flow.known[..., None], flow.shift_mm, np.nan)
    longest_mm = maps.draw_arrows(axis, flow.x_mm, flow.y_mm, shift_mm, np.zeros(2))
    maps.draw_outlines(axis, press.result.contacts or ())
    maps.format_map(axis, (flow.x_mm[[0, -1]], flow.y_mm[[0, -1]]))
    axis.set_title(f"{press.indenter}, {press.depth_mm:.2f} mm", loc="left", fontweight="bold")
    axis.set_xlabel(f"x, mm; arrows at most {longest_mm:.2f} mm")


def plot_force_motion(t_s: pd.Series[float], frames: pd.DataFrame, moved_px: list[float]) -> Figure:
    """Plot force on the sensor and image motion of an imported run over time."""
    columns = [name for name in RunMeasurement.FORCE_COLUMNS if frames[name].notna().any()]
    figure, axes = figures.create_panels(2 if columns else 1, 3.4, share_y=False)
    for axis in axes:
        axis.set_xlabel("time since the first image, s")
    for colour, name in zip(SERIES_COLOURS, columns, strict=False):
        axes[0].plot(t_s, frames[name], color=colour, lw=1.2, label=f"$F_{name[1]}$")
    if columns:
        axes[0].set_ylabel("force on the sensor, N")
        draw_legend(figure, axes[0])
    axes[-1].plot(t_s, moved_px, color=SOFT_COLOUR, lw=1.2)
    axes[-1].set_ylabel("mean image motion, px")
    return figure


def plot_force_by_frame(frames: pd.DataFrame) -> Figure:
    """Plot force on the sensor against the frame, a panel per indenter.

    With estimates from the flow (columns of `Force.frames`), the sensor's force is thick and pale.
    """
    indenters = list(dict.fromkeys(frames["indenter"]))
    estimated = f"{RunMeasurement.FORCE_COLUMNS[0]}_est" in frames
    figure, axes = figures.create_panels(len(indenters), 3.4)
    for axis, indenter in zip(axes, indenters, strict=True):
        part = frames[frames["indenter"] == indenter].reset_index(drop=True)
        index = np.arange(1, len(part) + 1)
        for colour, column, label in zip(
            SERIES_COLOURS, RunMeasurement.FORCE_COLUMNS, ("$F_x$", "$F_y$", "$F_z$"), strict=False
        ):
            if estimated:
                axis.plot(index, part[column], color=colour, lw=4, alpha=0.4)
            force_n = part[f"{column}_est" if estimated else column]
            axis.plot(index, force_n, color=colour, lw=1.2, label=label)
        if estimated:
            axis.plot([], [], color=SOFT_COLOUR, lw=4, alpha=0.4, label="force sensor")
            axis.plot([], [], "|", color=figures.DOUBT_COLOUR, ms=9, label="untrusted")
            doubtful = index[(part["extrapolated"] | ~part["trusted"]).to_numpy()]
            for number in doubtful:  # one by one: plots only the marks
                axis.plot(number, 0, "|", color=figures.DOUBT_COLOUR, ms=9, clip_on=False,
                          transform=axis.get_xaxis_transform())  # fmt: skip
        label_frames(axis, part["step_id"])
        axis.set_title(indenter, loc="left", fontweight="bold")
    axes[0].set_ylabel("force on the sensor, N")
    draw_legend(figure, axes[-1])
    return figure


def plot_predicted_force(result: ForceResult) -> ReportFigure:
    """Plot predicted against measured force of a calibration, with its data's origin."""
    caption = "Predicted against measured force. Each point by a model fitted without it: "
    words = f"{caption}{result.SPLITS[result.best.ranked_by]}."
    return ReportFigure("force-predicted", words, partial(_predicted, result))


def _predicted(result: ForceResult) -> Figure:
    """Rows: models (paper, best); panels: components; colours: indenters."""
    models = {model.name: model for model in (result.paper, result.best)}.values()
    figure, axes = figures.create_figure(9.6, 3.3 * len(models), 3, share_y=False, rows=len(models))
    balls = list(dict.fromkeys(result.data.points["indenter"]))
    for model, row in zip(models, np.reshape(axes, (-1, 3)), strict=True):
        for name, axis in zip(result.COMPONENTS, row, strict=True):
            measured = result.wrench_component(name)
            predicted = model.component(name, model.ranked_by).mean(axis=0)
            low, high = float(np.nanmin(predicted)), float(np.nanmax(predicted))
            room = 0.05 * max(high - low, 0.1)
            axis.plot([low, high], [low, high], color=SOFT_COLOUR, lw=1)
            axis.set_xlim(low - room, high + room)
            for colour, ball in zip(SERIES_COLOURS, balls, strict=False):
                mask = (result.data.points["indenter"] == ball).to_numpy()
                axis.plot(measured[mask], predicted[mask], ".", ms=3, color=colour, label=ball)
            axis.set_xlabel(f"{name.replace('_', ' ')} measured, N")
            axis.set_title(f"{model.name}, {name.replace('_', ' ')}", loc="left", fontweight="bold")
        row[0].set_ylabel("predicted, N")
    draw_legend(figure, axes[0])
    figure.text(0.995, 0.005, result.calibration.head.origin, ha="right", fontsize=7)
    return figure
