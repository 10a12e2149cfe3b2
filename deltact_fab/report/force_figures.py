"""Figures of a force calibration."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..analysis.force import FORCES, ForceResult, component, enough
from . import figures
from .result import ReportFigure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..analysis.force.judge import EvaluatedModel

GOAL_N = 0.2
_WORDS = {"normal": "normal", "shear_x": "shear x", "shear_y": "shear y"}


def drawn(result: ForceResult) -> list[ReportFigure]:
    """Those that a result has something to show in."""
    shown = [
        ("force-predicted", predicted_against_measured,
         "Predicted against measured force. Each point by a model that never saw its position."),
        ("force-residual", residual_by_prediction,
         "Residual, predicted less measured, against the prediction. A fan that opens is a wrong "
         "factor, a bend what a linear model cannot say."),
        ("force-place", residual_by_position,
         "Mean residual of the normal force over all presses at a place of the face."),
    ]  # fmt: skip
    if any(result.curves.values()):
        shown.append(
            ("force-learning", learning,
             "Error on the presses left out against the number of presses fitted to; the bands "
             "are the 10th to the 90th percentile of draws.")
        )  # fmt: skip
    return [ReportFigure(name, text, _signed(make, result)) for name, make, text in shown]


def all_figures(result: ForceResult) -> dict[str, Figure]:
    """By the name of the file."""
    return {one.name: one.draw() for one in drawn(result)}


def _signed(make: Callable[[ForceResult], Figure], result: ForceResult) -> Callable[[], Figure]:
    """With where its data is from in the corner."""

    def draw() -> Figure:
        figure = make(result)
        figure.text(0.995, 0.005, result.calibration.head.origin, ha="right", fontsize=7)
        return figure

    return draw


def predicted_against_measured(result: ForceResult) -> Figure:
    """Three components, the paper's model above and the best below, each point left out once."""
    models = _shown(result)
    figure, axes = figures.blank(9.6, 3.3 * len(models), 3, share_y=False, rows=len(models))
    for (one, group), row in zip(models, np.reshape(axes, (-1, 3)), strict=True):
        for name, axis in zip(FORCES, row, strict=True):
            measured = component(result.data.wrench, name)
            said = component(one.predicted[group], name)
            low, high = float(measured.min()), float(measured.max())
            room = 0.05 * max(high - low, 0.1)
            axis.plot([low, high], [low, high], color=figures.PAPER_COLOUR, lw=1)
            for colour, ball in zip(figures.COLOURS, _balls(result), strict=False):
                mine = (result.data.points["indenter"] == ball).to_numpy()
                axis.plot(measured[mine], said[mine], ".", ms=3, color=colour, label=ball)
            axis.set_xlim(low - room, high + room)
            axis.set_xlabel(f"{_WORDS[name]} measured, N")
            axis.set_title(f"{one.name}, {_WORDS[name]}", loc="left", fontweight="bold")
        row[0].set_ylabel(f"predicted, N ({_left_out(group)})")
    figures.legend_below(figure, axes[0])
    return figure


def residual_by_prediction(result: ForceResult) -> Figure:
    """Three components, the paper's model above and the best below."""
    models = _shown(result)
    figure, axes = figures.blank(9.6, 2.8 * len(models), 3, share_y=False, rows=len(models))
    for (one, group), row in zip(models, np.reshape(axes, (-1, 3)), strict=True):
        for name, axis in zip(FORCES, row, strict=True):
            said = component(one.predicted[group], name)
            off = said - component(result.data.wrench, name)
            axis.axhline(0, color=figures.PAPER_COLOUR, lw=1)
            for colour, ball in zip(figures.COLOURS, _balls(result), strict=False):
                mine = (result.data.points["indenter"] == ball).to_numpy()
                axis.plot(said[mine], off[mine], ".", ms=3, color=colour, label=ball)
            axis.set_xlabel(f"{_WORDS[name]} predicted, N")
            axis.set_title(f"{one.name}, {_WORDS[name]}", loc="left", fontweight="bold")
        row[0].set_ylabel(f"residual, N ({_left_out(group)})")
    figures.legend_below(figure, axes[0])
    return figure


def residual_by_position(result: ForceResult) -> Figure:
    """Mean signed error of the normal force of all presses at a place, on the face."""
    models = _shown(result)
    figure, axes = figures.blank(4.8 * len(models), 3.9, len(models))
    for (one, group), axis in zip(models, axes, strict=True):
        x_mm, y_mm, error_n = _by_place(result, one, group).T
        most = float(np.abs(error_n).max()) or 1.0  # each its own scale, or the better one is white
        marks = axis.scatter(
            x_mm, y_mm, c=error_n, s=70, cmap="RdBu_r", vmin=-most, vmax=most,
            edgecolors=figures.SOFT, linewidths=0.5,
        )  # fmt: skip
        reach = 2 + max(float(np.abs(x_mm).max()), float(np.abs(y_mm).max()))
        axis.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
        axis.set_xlabel("x of the press, mm")
        axis.set_title(f"{one.name} ({_left_out(group)})", loc="left", fontweight="bold")
        figure.colorbar(marks, ax=axis, label="mean error of the normal force, N")
    axes[0].set_ylabel("y, mm")
    return figure


def learning(result: ForceResult) -> Figure:
    """Error of the force on presses left out, against the number of presses fitted to."""
    figure, (axis,) = figures.blank(7.4, 3.9)
    for colour, (name, curve) in zip(figures.COLOURS, result.curves.items(), strict=False):
        known = [point for point in curve if point.force_error_n is not None]
        x = [point.presses for point in known]
        few = enough(curve)
        label = name if few is None else f"{name}: more than {few} presses bring little"
        axis.fill_between(
            x, [p.low_n or 0 for p in known], [p.high_n or 0 for p in known], color=colour,
            alpha=0.15, lw=0,
        )  # fmt: skip
        axis.plot(x, [p.force_error_n or 0 for p in known], "o-", color=colour, ms=4, label=label)
    axis.axhline(GOAL_N, color=figures.PAPER_COLOUR, lw=1.2, ls=":", label=f"{GOAL_N} N")
    figures.log_ticks(axis, "xy")
    axis.set_xlabel("presses used for the fit")
    axis.set_ylabel("error of the force on the others, N")
    figures.legend_below(figure, axis)
    return figure


def _shown(result: ForceResult) -> list[tuple[EvaluatedModel, str]]:
    """The paper's model and the best, and what was left out for the predictions shown."""
    models = [one for one in (result.paper, result.best) if one is not None]
    unlike = list({one.name: one for one in models}.values())
    return [(one, "position" if "position" in one.predicted else "test") for one in unlike]


def _left_out(group: str) -> str:
    return "position left out" if group == "position" else "test points and training"


def _balls(result: ForceResult) -> list[str]:
    return list(dict.fromkeys(result.data.points["indenter"]))


def _by_place(result: ForceResult, one: EvaluatedModel, group: str) -> NDArray[Any]:
    """x, y and the mean error of the normal force of the presses there, (n, 3)."""
    error = component(one.predicted[group] - result.data.wrench, "normal")
    table = result.data.points[["x_mm", "y_mm"]].assign(error=error)
    return np.asarray(table.groupby(["x_mm", "y_mm"], as_index=False)["error"].mean())
