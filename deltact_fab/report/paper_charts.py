"""The paper's chart of its pattern selection, redrawn: a stacked column a pattern."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from . import figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
