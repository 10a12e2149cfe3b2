"""Figures of a force calibration."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

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

    def signed(make: Callable[[ForceResult], Figure]) -> Figure:
        figure = make(result)
        # Where its data is from, in the corner.
        figure.text(0.995, 0.005, result.calibration.head.origin, ha="right", fontsize=7)
        return figure

    return [ReportFigure(name, text, partial(signed, make)) for name, make, text in shown]


def predicted_against_measured(result: ForceResult) -> Figure:
    """Three components, the paper's model above and the best below, each point left out once."""
    return _by_component(result, residual=False)


def residual_by_prediction(result: ForceResult) -> Figure:
    """Three components, the paper's model above and the best below."""
    return _by_component(result, residual=True)


def _by_component(result: ForceResult, residual: bool) -> Figure:
    """A row a model, a panel a component, a colour an indenter."""
    models = _shown(result)
    height = (2.8 if residual else 3.3) * len(models)
    figure, axes = figures.blank(9.6, height, 3, share_y=False, rows=len(models))
    balls = list(dict.fromkeys(result.data.points["indenter"]))
    across, up = ("predicted", "residual") if residual else ("measured", "predicted")
    for (one, group), row in zip(models, np.reshape(axes, (-1, 3)), strict=True):
        for name, axis in zip(FORCES, row, strict=True):
            measured = component(result.data.wrench, name)
            said = component(one.predicted[group], name)
            x, y = (said, said - measured) if residual else (measured, said)
            if residual:
                axis.axhline(0, color=figures.PAPER_COLOUR, lw=1)
            else:
                low, high = float(x.min()), float(x.max())
                room = 0.05 * max(high - low, 0.1)
                axis.plot([low, high], [low, high], color=figures.PAPER_COLOUR, lw=1)
                axis.set_xlim(low - room, high + room)
            for colour, ball in zip(figures.COLOURS, balls, strict=False):
                mine = (result.data.points["indenter"] == ball).to_numpy()
                axis.plot(x[mine], y[mine], ".", ms=3, color=colour, label=ball)
            axis.set_xlabel(f"{_WORDS[name]} {across}, N")
            axis.set_title(f"{one.name}, {_WORDS[name]}", loc="left", fontweight="bold")
        row[0].set_ylabel(f"{up}, N ({_left_out(group)})")
    figures.legend_below(figure, axes[0])
    return figure


def residual_by_position(result: ForceResult) -> Figure:
    """Mean signed error of the normal force of all presses at a place, on the face."""
    models = _shown(result)
    figure, axes = figures.blank(4.8 * len(models), 3.9, len(models))
    for (one, group), axis in zip(models, axes, strict=True):
        error = component(one.predicted[group] - result.data.wrench, "normal")
        table = result.data.points[["x_mm", "y_mm"]].assign(error=error)
        places = table.groupby(["x_mm", "y_mm"], as_index=False)["error"].mean()
        x_mm, y_mm, error_n = places.to_numpy().T
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
    unlike = list({one.name: one for one in (result.paper, result.best)}.values())
    return [(one, "position" if "position" in one.predicted else "test") for one in unlike]


def _left_out(group: str) -> str:
    return "position left out" if group == "position" else "test points and training"
