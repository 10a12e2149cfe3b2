"""Tables and figures of a pattern search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...report.figures import COLOURS, INK, PAPER_COLOUR, SOFT, blank, legend_below, log_ticks
from ...report.result import ReportFigure, ReportTable
from .confirm import SHOWN_MM
from .findings import DEFAULT, ConfirmedPattern, Findings
from .search import ERROR, PREDICTORS

if TYPE_CHECKING:
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


def confirmed_errors(found: Sequence[ConfirmedPattern], best: str, paper: str) -> Figure:
    """Mean error of each confirmed pattern with its interval, the best at the top."""
    rows = found[::-1]
    figure, (axis,) = blank(9.6, 0.32 * len(rows) + 1.1)
    for i, one in enumerate(rows):
        colour = {best: COLOURS[2], paper: COLOURS[4]}.get(one.pattern, COLOURS[0])
        if one.error.low is not None and one.error.high is not None:
            axis.plot([UM * one.error.low, UM * one.error.high], [i, i], color=colour, lw=2)
        axis.plot(UM * one.error.value, i, "o", color=colour, ms=6)
    axis.set_yticks(np.arange(len(rows)), [one.pattern for one in rows])
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


WORDS = {
    "error_mm": "mean error, mm",
    "bridged_mm": "bridged, mm",
    "leap_error_mm": "leap, mm",
}
CONFIRMED_WORDS = {
    "mean_error_mm": "mean error, mm",
    "low_mm": "from",
    "high_mm": "to",
    "confident_error_mm": "of the confident, mm",
    "p95_error_mm": "95th percentile, mm",
    "share_of_paper": "share of the paper's",
}
ORDERS = {"": "mean error", "sure": "of the sure", "lost": "not sure of", "gel": "gel"}
"""Of `Findings.orders`: what stands above a column of the table."""


def tables(found: Findings) -> tuple[ReportTable, ...]:
    """What was confirmed, the candidates, what orders them, and two predictors together."""
    both = (*found.ours, *found.farneback)
    confirmed = pd.DataFrame([c.as_row() for c in both])
    if len(found.presses) > 1:
        for k, press in enumerate(found.presses):
            confirmed[f"{press.replace('/', '-')}_mm"] = [c.by_press_mm[k] for c in both]
    paper = found.of(found.ours, found.paper)
    if paper is not None:
        confirmed["share_of_paper"] = [
            c.error.value / paper.error.value if c.method == DEFAULT else None for c in both
        ]
    columns = (
        "pattern", "error_mm", "coverage", "bridged_mm", "leap_error_mm",
        *(p.column for p in PREDICTORS), "refused",
    )  # fmt: skip
    orders, words = found.orders[""], {"needs_tracker": "needs a tracker"}
    for name, order in found.orders.items():
        suffix = name and f"_{name}"
        part = order[["predictor", "rho", "low", "high"]]
        if suffix:
            orders = orders.merge(part, on="predictor", how="left", suffixes=("", suffix))
        words |= {f"rho{suffix}": ORDERS[name], f"low{suffix}": "from", f"high{suffix}": "to"}
    return (
        ReportTable(
            "confirmed",
            "Confirmed on the finite-strain gel. Means over "
            f"{found.size.held_out} seeds that the search has not seen.",
            confirmed,
            words=CONFIRMED_WORDS,
        ),
        ReportTable(
            "candidates",
            f"The candidates. Means over {found.size.seeds} seeds, best first; of the longest "
            "step that is bridged the least; leap: all of the motion in one step.",
            found.frame,
            tuple(c for c in columns if c in found.frame),
            WORDS | {p.column: p.words for p in PREDICTORS},
        ),
        ReportTable(
            "predictors",
            "What orders them. Rank correlation with the candidates' mean error, with that of the "
            "pixels that the tracker is sure of, with the share that it is not sure of, and with "
            "the mean error on the gel where it is known; 1: what it calls better is better.",
            orders,
            tuple(str(c) for c in orders if c not in ("column", "over", "patterns")),
            words,
        ),
    )


def drawn(found: Findings) -> tuple[ReportFigure, ...]:
    """What was confirmed, each predictor, how well they order, and what the camera sees."""
    numbered = ", ".join(f"{i} {name}" for i, name in enumerate(found.finalists, start=1))
    names = dict.fromkeys((found.best.pattern, *found.finalists[:3], found.paper))
    pictures = {n: found.seen[f"picture/{n}"] for n in names if f"picture/{n}" in found.seen}
    orders = {
        "mean error": found.orders[""],
        "error of the sure": found.orders["sure"],
        "share not sure of": found.orders["lost"],
    }
    out = [
        ReportFigure(
            "confirmed",
            "Mean error on the finite-strain gel with its 95 % interval over the seeds; simulated.",
            partial(confirmed_errors, found.ours, found.best.pattern, found.paper),
        ),
        ReportFigure(
            "predictors-against-error",
            "Each predictor against the candidates' error, in the search; rings: the paper's and "
            f"the finalists, {numbered}.",
            partial(predictors_against_error, found.frame, found.finalists, found.paper),
        ),
        ReportFigure(
            "rank-correlations",
            "How well each predictor orders the candidates, with its 95 % interval over kinds of "
            "pattern: by their mean error, by that of the pixels that the tracker is sure of, and "
            "by the share that it is not sure of.",
            partial(correlations, orders),
        ),
    ]
    if pictures:
        words = {found.paper: f"the paper's: {found.paper}"}
        out.append(
            ReportFigure(
                "seen",
                "Patterns at rest as the camera sees them.",
                partial(strip, pictures, words),
            )
        )
    return tuple(out)
