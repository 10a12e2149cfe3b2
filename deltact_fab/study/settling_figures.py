"""The figures of the settling study."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from ..analysis.relaxation import Series, time_to
from ..report import figures
from .settling_stops import SHARES, Stop

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MIN_PCT = 0.05
MIN_N = 1e-4
TOTALS = (0.05, 0.1, 0.2, 0.4)


def curve(stops: Sequence[Stop], series: Series, marks: bool) -> Figure:
    """Error against waiting time, a panel for presses and one for drags.

    marks: the stops' own values are points (solved knots), else a line (samples).
    """
    figure, axes = figures.blank(9.6, 3.8, 2)
    for axis, kind, words in zip(axes, ("press", "shear"), ("after a press", "after a drag"),
                                 strict=True):  # fmt: skip
        for colour, stop in zip(cycle(figures.COLOURS), _one_a_depth(stops, kind), strict=False):
            later = stop.wait_s > 0
            wait, steady = stop.wait_s[later], stop.steady / 100
            own = {"marker": "o", "ms": 3, "ls": ""} if marks else {"lw": 0.6, "alpha": 0.5}
            axis.plot(wait, stop.excess_n()[later] / steady, color=colour,
                      label=f"{stop.depth_mm:g} mm", **own)  # fmt: skip
            axis.plot(wait, stop.excess_by_series_n()[later] / steady, color=colour, lw=1.4)
        for share in SHARES:
            axis.axhline(100 * share, color=figures.PAPER_COLOUR, lw=0.6, ls=":")
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel("wait, s")
        axis.set_title(words, loc="left", fontweight="bold")
    axes[0].set_ylabel("force over its steady value, %")
    low, high = axes[0].get_ylim()
    axes[0].set_ylim(max(low, MIN_PCT), high)
    figures.legend_below(figure, axes[0])
    return figure


def _one_a_depth(stops: Sequence[Stop], kind: str) -> list[Stop]:
    first: dict[float, Stop] = {}
    for stop in stops:
        if stop.kind == kind:
            first.setdefault(stop.depth_mm, stop)
    return list(first.values())


def sensitivity(ramp_s: float, share: float) -> Figure:
    """Wait for a share, against the time of relaxation, for gels that relax by so much."""
    figure, (axis,) = figures.blank(4.8, 3.4)
    taus = np.geomspace(0.05, 100.0, 61)
    for colour, total in zip(figures.COLOURS, TOTALS, strict=False):
        found = []
        for tau in taus:
            wait = np.linspace(0.0, 12 * tau, 400)
            found.append(time_to(wait, Series((total,), (tau,)).after_ramp(ramp_s, wait), share))
        axis.plot(taus, np.maximum(found, 1e-3), color=colour, label=f"{100 * total:g} % fades")
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_ylim(0.02, None)
    axis.set_xlabel("time of relaxation, s")
    axis.set_ylabel(f"wait for {100 * share:g} %, s")
    figures.legend_below(figure, axis)
    return figure


def judged(tables: dict[str, list[dict[str, float]]]) -> Figure:
    """What a protocol's stops scatter by, against how long they rest."""
    figure, axes = figures.blank(9.6, 3.4, 2)
    for axis, column, words in zip(
        axes, ("normal_scatter_n", "shear_scatter_n"), ("normal force", "shear"), strict=True
    ):
        for colour, (name, rows) in zip(cycle(figures.COLOURS), tables.items(), strict=False):
            tried = sorted(rows, key=lambda row: row["settle_s"])
            rest, scatter = (np.array([row[key] for row in tried]) for key in ("settle_s", column))
            if scatter.max() > MIN_N:
                axis.plot(rest, scatter, color=colour, lw=1.4, label=name)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel("settle_s, s")
        axis.set_title(words, loc="left", fontweight="bold")
    axes[0].set_ylabel("scatter among the stops, N")
    axes[0].set_ylim(MIN_N, None)
    figures.legend_below(figure, axes[0])
    return figure
