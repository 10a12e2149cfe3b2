"""Figures of a force calibration."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..analysis.force import FORCES, SPLITS, ForceResult, component
from . import figures
from .result import ReportFigure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def drawn(result: ForceResult) -> list[ReportFigure]:
    """The figure of a calibration, signed with where its data is from."""

    caption = "Predicted against measured force. Each point by a model fitted without it: "
    return [
        ReportFigure(
            "force-predicted",
            f"{caption}{SPLITS[result.best.ranked_by]}.",
            partial(_predicted, result),
        )
    ]


def _predicted(result: ForceResult) -> Figure:
    """A row a model (the paper's, the best), a panel a component, a colour an indenter."""
    models = {one.name: one for one in (result.paper, result.best)}.values()
    figure, axes = figures.blank(9.6, 3.3 * len(models), 3, share_y=False, rows=len(models))
    balls = list(dict.fromkeys(result.data.points["indenter"]))
    for one, row in zip(models, np.reshape(axes, (-1, 3)), strict=True):
        predicted = one.predicted[one.ranked_by].mean(axis=0)
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
    figure.text(0.995, 0.005, result.calibration.head.origin, ha="right", fontsize=7)
    return figure
