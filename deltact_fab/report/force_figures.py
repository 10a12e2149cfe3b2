"""Figures of a force calibration."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..aliases import Array
from ..analysis.force import FORCES, SPLITS, ForceResult, component
from . import figures
from .result import ReportFigure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..analysis.force.judge import EvaluatedModel


def drawn(result: ForceResult) -> list[ReportFigure]:
    """Those that a result has something to show in."""
    left_out = SPLITS[result.best.ranked_by]
    shown = [
        ("force-predicted", predicted_against_measured,
         f"Predicted against measured force. Each point by a model fitted without it: {left_out}."),
        ("force-place", residual_by_position,
         "Mean residual of the normal force, predicted less measured, at each place."),
    ]  # fmt: skip

    def signed(make: Callable[[ForceResult], Figure]) -> Figure:
        figure = make(result)
        # Where its data is from, in the corner.
        figure.text(0.995, 0.005, result.calibration.head.origin, ha="right", fontsize=7)
        return figure

    return [ReportFigure(name, text, partial(signed, make)) for name, make, text in shown]


def predicted_against_measured(result: ForceResult) -> Figure:
    """A row a model (the paper's, the best), a panel a component, a colour an indenter."""
    models = _shown(result)
    figure, axes = figures.blank(9.6, 3.3 * len(models), 3, share_y=False, rows=len(models))
    balls = list(dict.fromkeys(result.data.points["indenter"]))
    for (one, predicted), row in zip(models, np.reshape(axes, (-1, 3)), strict=True):
        for name, axis in zip(FORCES, row, strict=True):
            measured, said = (component(w, name) for w in (result.data.wrench, predicted))
            low, high = float(np.nanmin(said)), float(np.nanmax(said))
            room = 0.05 * max(high - low, 0.1)
            axis.plot([low, high], [low, high], color=figures.PAPER_COLOUR, lw=1)
            axis.set_xlim(low - room, high + room)
            for colour, ball in zip(figures.COLOURS, balls, strict=False):
                mine = (result.data.points["indenter"] == ball).to_numpy()
                axis.plot(measured[mine], said[mine], ".", ms=3, color=colour, label=ball)
            axis.set_xlabel(f"{name.replace('_', ' ')} measured, N")
            axis.set_title(f"{one.name}, {name.replace('_', ' ')}", loc="left", fontweight="bold")
        row[0].set_ylabel("predicted, N")
    figures.legend_below(figure, axes[0])
    return figure


def residual_by_position(result: ForceResult) -> Figure:
    """Mean signed error of the normal force of all presses at a place, on the face."""
    models = _shown(result)
    figure, axes = figures.blank(4.8 * len(models), 3.9, len(models))
    for (one, predicted), axis in zip(models, axes, strict=True):
        error = component(predicted - result.data.wrench, "normal")
        table = result.data.points[["x_mm", "y_mm"]].assign(error=error)
        places = table.groupby(["x_mm", "y_mm"], as_index=False)["error"].mean()
        x_mm, y_mm, error_n = places.to_numpy().T
        most = (
            float(np.nanmax(np.abs(error_n))) or 1.0
        )  # each its own scale, or the better one is white
        marks = axis.scatter(
            x_mm, y_mm, c=error_n, s=70, cmap="RdBu_r", vmin=-most, vmax=most,
            edgecolors=figures.SOFT, linewidths=0.5,
        )  # fmt: skip
        reach = 2 + max(float(np.abs(x_mm).max()), float(np.abs(y_mm).max()))
        axis.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
        axis.set_xlabel("x of the press, mm")
        axis.set_title(one.name, loc="left", fontweight="bold")
        figure.colorbar(marks, ax=axis, label="mean error of the normal force, N")
    axes[0].set_ylabel("y, mm")
    return figure


def _shown(result: ForceResult) -> list[tuple[EvaluatedModel, Array]]:
    """The paper's model and the best, and what they predict (n, 6) of points left out."""
    unlike = {one.name: one for one in (result.paper, result.best)}.values()
    return [(one, one.predicted[one.ranked_by].mean(axis=0)) for one in unlike]
