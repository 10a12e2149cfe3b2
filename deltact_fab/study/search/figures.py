"""Figures of a pattern search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...report.figures import COLOURS, INK, PAPER_COLOUR, SOFT, blank, legend_below, log_ticks
from .confirm import SHOWN_MM
from .search import ERROR, PREDICTORS

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

UM = 1000.0


def predictors_against_error(frame: pd.DataFrame, named: Sequence[str], paper: str) -> Figure:
    """A panel a predictor, a mark a candidate; rings: the named ones, by their numbers."""
    known = frame[frame[ERROR].notna()]
    figure, axes = blank(9.6, 7.2, 4, rows=3)
    families = list(dict.fromkeys(known["family"]))
    for axis, p in zip(axes, PREDICTORS, strict=False):
        for colour, family in zip(cycle(COLOURS), families, strict=False):
            part = known[known["family"] == family]
            axis.plot(part[p.column], UM * part[ERROR], "o", ms=4, color=colour, label=family)
        for mark, name in (*enumerate(named, start=1), ("paper", paper)):
            row = known[known["pattern"] == name]
            if len(row):
                at = float(row[p.column].iloc[0]), UM * float(row[ERROR].iloc[0])
                colour = PAPER_COLOUR if name == paper else INK
                axis.plot(*at, "o", ms=8, mfc="none", color=colour)
                axis.annotate(str(mark), at, xytext=(5, -9), textcoords="offset points", fontsize=8)
        positive = known[p.column].to_numpy(float)
        log_ticks(axis, "xy" if positive.min() > 0 and np.ptp(np.log(positive)) > 1 else "y")
        axis.tick_params(labelsize=7.5)
        axis.set_xlabel(f"{p.words}{', px' if p.column.endswith('_px') else ''}", fontsize=8.5)
    for axis in axes[len(PREDICTORS) :]:
        axis.set_visible(False)
    for first in range(0, len(axes), 4):
        axes[first].set_ylabel("mean error, µm")
    legend_below(figure, axes[0])
    return figure


def correlations(orders: Mapping[str, pd.DataFrame]) -> Figure:
    """Rank correlation of each predictor with several errors, a panel each, with its interval."""
    names = list(next(iter(orders.values()))["predictor"])[::-1]
    figure, axes = blank(9.6, 0.32 * len(names) + 1.2, len(orders))
    for axis, (title, order) in zip(axes, orders.items(), strict=True):
        for _, row in order.iterrows():
            at = names.index(row["predictor"])
            colour = COLOURS[0] if row["needs_tracker"] else COLOURS[1]
            if row["low"] is not None:
                axis.plot([row["low"], row["high"]], [at, at], color=colour, lw=2)
            axis.plot(row["rho"], at, "o", color=colour, ms=6)
        axis.set_yticks(np.arange(len(names)), names)
        axis.axvline(0, color=SOFT, lw=0.8)
        axis.set_xlim(-1, 1.02)
        axis.set_title(title, loc="left", fontsize=8.5)
    axes[len(axes) // 2].set_xlabel("rank correlation: 1, what it calls better is better")
    for colour, words in ((COLOURS[0], "needs a tracker"), (COLOURS[1], "of one image alone")):
        axes[0].plot([], [], "o-", color=colour, label=words)
    legend_below(figure, axes[0])
    return figure


def confirmed_errors(rows: Sequence[Mapping[str, Any]], best: str, paper: str) -> Figure:
    """Mean error of each confirmed pattern with its interval, the best at the top."""
    figure, (axis,) = blank(9.6, 0.32 * len(rows) + 1.1)
    for i, row in enumerate(reversed(rows)):
        colour = {best: COLOURS[2], paper: COLOURS[4]}.get(row["pattern"], COLOURS[0])
        if row["low_mm"] is not None:
            axis.plot([UM * row["low_mm"], UM * row["high_mm"]], [i, i], color=colour, lw=2)
        axis.plot(UM * row["mean_error_mm"], i, "o", color=colour, ms=6)
    axis.set_yticks(np.arange(len(rows)), [row["pattern"] for row in reversed(rows)])
    axis.set_xlabel("mean error of the moving pixels on the finite-strain gel, µm")
    log_ticks(axis, "x")
    return figure


def strip(pictures: Mapping[str, NDArray[np.uint8]], words: Mapping[str, str]) -> Figure:
    """Patterns at rest as the camera sees them, a square of the face each."""
    figure, axes = blank(9.6, 2.6, len(pictures), share_y=False)
    for axis, (name, picture) in zip(axes, pictures.items(), strict=True):
        axis.imshow(picture, interpolation="nearest", extent=(0, SHOWN_MM, SHOWN_MM, 0))
        axis.set_title(words.get(name, name), fontsize=8, loc="left")
        axis.grid(visible=False)
        axis.set_xticks([0, SHOWN_MM], ["0", f"{SHOWN_MM:g} mm"], fontsize=8)
        axis.set_yticks([])
    return figure
