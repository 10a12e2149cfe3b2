"""The paper's charts, redrawn: sensors by size, and its pattern selection as stacked columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from . import figures
from .figures import COLOURS, PAPER_COLOUR, blank, legend_below, log_ticks, name_marks

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

# Where a sensor's figures are from.
TABLE, FIGURE, OWN = "the paper's table", "the paper's figure", "own design"
LINES_MM2_PER_CM3 = (3, 10, 30)


def area_against_volume(table: pd.DataFrame) -> Figure:
    """A mark a sensor, with lines of equal area a volume.

    table: columns sensor, from (TABLE, FIGURE or OWN), volume_cm3, sensing_area_mm2; a row without
    an area has no mark, and those on one spot share their label.
    """
    rows = table.rename(columns={"volume_cm3": "x", "sensing_area_mm2": "y"}).dropna(subset="y")
    figure, (axis,) = blank(9.6, 4.6)
    log_ticks(axis, "x")
    least, most, highest = rows["x"].min() / 1.5, rows["x"].max() * 1.9, rows["y"].max() * 1.12
    for ratio in LINES_MM2_PER_CM3:
        x = np.geomspace(least, min(most, highest / ratio), 40)
        axis.plot(x, ratio * x, color=PAPER_COLOUR, lw=0.7, ls=":")
        axis.text(x[-1], ratio * x[-1], f"{ratio:g} ", fontsize=7.5, color=PAPER_COLOUR, ha="right",
                  va="top" if ratio * x[-1] > 0.98 * highest else "bottom")  # fmt: skip
    marks = []
    for colour, (group, part) in zip(COLOURS, rows.groupby("from", sort=False), strict=False):
        axis.plot(part["x"], part["y"], "o", color=colour, ms=7, label=group)
        spots = part.groupby(["x", "y"])["sensor"].agg(", ".join)
        marks += [(x, y, names, colour) for x, y, names in spots.reset_index().to_numpy()]
    axis.set(xlim=(least, most), ylim=(0, highest))
    axis.set(xlabel="outer volume, cm³", ylabel="sensing area, mm²")
    legend_below(figure, axis)
    name_marks(figure, axis, marks)
    return figure


@dataclass(frozen=True)
class PatternColumn:
    """parts_mm: what each indenter adds to the pattern's mean, None where it was not measured.

    paper_mm: the paper's own value; paper_about: it is said of several patterns.
    """

    label: str
    parts_mm: tuple[float | None, ...]
    low_mm: float | None
    high_mm: float | None
    paper_mm: float | None = None
    paper_about: bool = False


def stacked(
    panels: Sequence[tuple[str, Sequence[PatternColumn]]], indenters: Sequence[str]
) -> Figure:
    """Panels one below the other, as the paper has its two rounds: (title, columns)."""
    figure, axes = figures.blank(7.4, 2.6 * len(panels) + 0.6, 1, rows=len(panels), share_y=False)
    for axis, (title, columns) in zip(axes, panels, strict=True):
        places = range(len(columns))
        below = [0.0] * len(columns)
        for k, indenter in enumerate(indenters):
            heights = [column.parts_mm[k] or 0.0 for column in columns]
            axis.bar(places, heights, 0.62, bottom=below, label=indenter,
                     color=figures.COLOURS[k % len(figures.COLOURS)])  # fmt: skip
            below = [b + h for b, h in zip(below, heights, strict=True)]
        for x, column, top in zip(places, columns, below, strict=True):
            if column.low_mm is not None and column.high_mm is not None:
                axis.plot(
                    [x, x], [max(column.low_mm, 0.0), column.high_mm], color=figures.INK, lw=0.9
                )
            elif any(part is None for part in column.parts_mm):
                axis.annotate("no dots", (x, top), ha="center", va="bottom", fontsize=7.5)
        highest = max([*below, *(column.high_mm or 0.0 for column in columns)])
        words = "the paper"
        for x, column in enumerate(columns):
            if column.paper_mm is not None:
                figures.paper_line(axis, column.paper_mm, highest, words, (x - 0.42, x + 0.42),
                                   column.paper_about)  # fmt: skip
                words = "_"  # the legend names it once
        axis.set_xticks(list(places), [column.label for column in columns])
        axis.set_title(title, loc="left", fontsize=9, pad=14)
        axis.set_ylabel("mean error, mm")
        axis.grid(visible=False, axis="x")
    figures.legend_below(figure, axes[0])
    return figure
