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


# Where a row's figures are from: the table's sensors, the figure's, our own.
GROUPS = {"table": COLOURS[0], "figure": COLOURS[1], "cad": COLOURS[2]}
WORDS = {
    "table": "the paper's table",
    "figure": "the paper's figure",
    "cad": "own design",
}
LINES_MM2_PER_CM3 = (3, 10, 30)


def volumes(table: pd.DataFrame) -> Figure:
    """A bar a sensor, the smallest on top.

    table: columns sensor, said_in (a key of GROUPS), volume_cm3.
    """
    rows = table.sort_values("volume_cm3", ascending=False, kind="stable")
    figure, (axis,) = blank(9.6, 0.8 + 0.29 * len(rows))
    for group, colour in GROUPS.items():
        at = np.flatnonzero((rows["said_in"] == group).to_numpy())
        if len(at):
            axis.barh(at, rows["volume_cm3"].iloc[at], 0.72, color=colour,
                      label=WORDS[group])  # fmt: skip
    for i, value in enumerate(rows["volume_cm3"]):
        axis.text(value, i, f" {value:.3g}", va="center", fontsize=8)
    axis.set_yticks(range(len(rows)), rows["sensor"])
    axis.set_xlabel("outer volume, cm³")
    axis.margins(x=0.09, y=0.01)
    axis.grid(axis="y", visible=False)
    legend_below(figure, axis)
    return figure


def area_against_volume(table: pd.DataFrame) -> Figure:
    """A mark a sensor, with lines of equal area a volume.

    table: as `volumes`, with area_mm2; a row without an area has no mark.
    """
    rows = table[table["area_mm2"].notna()]
    figure, (axis,) = blank(9.6, 4.6)
    log_ticks(axis, "x")
    least, most = rows["volume_cm3"].min() / 1.5, rows["volume_cm3"].max() * 1.9
    highest = rows["area_mm2"].max() * 1.12
    for ratio in LINES_MM2_PER_CM3:
        x = np.geomspace(least, min(most, highest / ratio), 40)
        axis.plot(x, ratio * x, color=PAPER_COLOUR, lw=0.7, ls=":")
        axis.text(x[-1], ratio * x[-1], f"{ratio:g} ", fontsize=7.5, color=PAPER_COLOUR, ha="right",
                  va="top" if ratio * x[-1] > 0.98 * highest else "bottom")  # fmt: skip
    for group, colour in GROUPS.items():
        part = rows[rows["said_in"] == group]
        axis.plot(part["volume_cm3"], part["area_mm2"], "o", color=colour, ms=7,
                  label=WORDS[group])  # fmt: skip
    axis.set_xlim(least, most)
    axis.set_ylim(0, highest)
    axis.set_xlabel("outer volume, cm³")
    axis.set_ylabel("sensing area, mm²")
    legend_below(figure, axis)
    name_marks(figure, axis, _marks(rows))
    return figure


def _marks(rows: pd.DataFrame) -> list[tuple[float, float, str, str]]:
    """(x, y, names, colour): those on one spot share their label."""
    found = []
    for group, colour in GROUPS.items():
        part = rows[rows["said_in"] == group]
        spots = part.groupby(["volume_cm3", "area_mm2"], sort=True)["sensor"]
        for _, names in spots:
            first, *rest = names
            x, y = part.loc[names.index[0], ["volume_cm3", "area_mm2"]]
            words = ", ".join([first, *(name.removeprefix("own: ") for name in rest)])
            found.append((float(x), float(y), words, colour))
    return found


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
        label: str | None = "the paper"
        for x, column in enumerate(columns):  # across its column; dashed where it says "around"
            if column.paper_mm is not None:
                line = "--" if column.paper_about else "-"
                ends = [x - 0.42, x + 0.42], [column.paper_mm] * 2
                axis.plot(*ends, line, label=label, lw=1.6, color=figures.PAPER_COLOUR)
                label = None
        axis.set_xticks(list(places), [column.label for column in columns])
        axis.set_title(title, loc="left", fontsize=9)
        axis.set_ylabel("mean error, mm")
        axis.grid(visible=False, axis="x")
    figures.legend_below(figure, axes[0])
    return figure
