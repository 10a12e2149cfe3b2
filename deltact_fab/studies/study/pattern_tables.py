"""Claims, figures, tables and charts of the pattern selection."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from deltact_fab.fabricate import PatternSeries, SeriesEntry
from deltact_fab.present import Claim, Headline, ReportFigure, ReportTable

from .intervals import Interval, headline
from .pattern_errors import COMPOSED, METHODS, OURS, SUMMED, Measure, PatternErrors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAPER_BEST = ((0.1, 0.5), (0.075, 0.6))
"""(d in mm, r) of the least error in each of the paper's rounds."""
TOO_SMALL_MM, SMALL_MM = 0.05, 0.075
KEPT = {
    SUMMED: ("mm", "moving_mm", "sum_mm", "lost_frames", "lost_pixels"),
    COMPOSED: ("mm", "moving_mm", "sum_mm", "lost_pixels"),
    OURS: ("mm", "off_mm"),
}
"""Of the table's columns those of the page; the file has all."""
SHORT = {SUMMED: "summed", COMPOSED: "composed", OURS: "ours"}
MEASURES: dict[Measure, str] = {"at_dots": "", "at_moving_dots": "moving_", "off_dots": "off_"}
"""The paper's over all dots, over those that move; ours over moving pixels off the dots."""


def claims(errors: PatternErrors) -> tuple[Claim, ...]:
    """Whether the paper's best of each round is best here, and whether small patches fail.

    Readings: flows summed and composed. Each pattern of a round is compared with the paper's, so
    the interval's level is that of as many comparisons together.
    """
    found = []
    rounds_ = rounds(errors.printed)[: len(PatternSeries.grids)]
    for number, ((_, part), best) in enumerate(zip(rounds_, PAPER_BEST, strict=False), start=1):
        theirs = next((p for p in part if (p.recipe.patch_mm, p.recipe.r) == best), None)
        others = [p for p in part if p != theirs]
        if theirs is None or not others:
            continue
        whole = len(part) == math.prod(map(len, PatternSeries.grids[number - 1]))
        level = 1 - 0.05 / len(others)
        readings, rivals = {}, []
        for method in (SUMMED, COMPOSED):
            if rival := errors.best(method, "at_dots", others):
                rivals.append(rival.label)
                apart = errors.times([rival.name], [theirs.name], method, level)
                readings[SHORT[method]] = _log_interval(apart)
        where = f"round {number} of the paper"
        found.append(
            Claim(
                f"The paper's {theirs.label} is the best of {where}.",
                f"{' and '.join(dict.fromkeys(rivals))} track better than the paper's "
                f"{theirs.label} in {where}.",
                f"Whether the paper's {theirs.label} is the best of {where} is not decided.",
                readings if whole else {},
            )
        )
    tiny, small = ([p.name for p in errors.printed if p.recipe.patch_mm == d_mm and 2 in p.rounds]
                   for d_mm in (TOO_SMALL_MM, SMALL_MM))  # fmt: skip
    if tiny and small:
        readings = {
            SHORT[m]: _log_interval(errors.times(tiny, small, m)) for m in (SUMMED, COMPOSED)
        }
        found.append(
            Claim(
                f"At d {TOO_SMALL_MM:g} mm the error rises, as in the paper.",
                f"At d {TOO_SMALL_MM:g} mm the error does not rise as in the paper.",
                f"Whether the error rises at d {TOO_SMALL_MM:g} mm is not decided.",
                readings,
            )
        )
    return tuple(found)


def _log_interval(times: Interval | None) -> tuple[float | None, float | None]:
    """The logarithms of a ratio's ends, above 0 where it is above 1."""
    ends = (None, None) if times is None else (times.low, times.high)
    low, high = (None if end is None else math.log(end) for end in ends)
    return low, high


def headlines(errors: PatternErrors) -> tuple[Headline, ...]:
    """The paper's figures beside those found, by each tracker; then the least of ours."""
    found = []
    for p in (p for p in errors.printed if p.paper_error_mm is not None and not p.paper_about):
        for method in errors.methods:
            if (known := errors.mean(p.name, method, "at_dots")) is not None:
                what = f"{p.label}, {METHODS.get(method, method)}, at the dots"
                paper_mm = None if method == OURS else p.paper_error_mm
                found.append(headline(what, "mm", known, paper=paper_mm, remark=_lost(
                    errors, p, method)))  # fmt: skip
    least = errors.best(OURS, "off_dots", errors.printed)
    if least and (known := errors.mean(least.name, OURS, "off_dots")):
        what = f"least error of {METHODS[OURS]}, {least.label}, moving pixels off the dots"
        found.append(headline(what, "mm", known, remark=_lost(errors, least, OURS)))
    return tuple(found)


def _lost(errors: PatternErrors, printed: SeriesEntry, method: str) -> str:
    """How much a tracker lost, in words."""
    whole = errors.figures(printed.name, method)
    return f"{_share(1 - whole['trusted_share'])} of frames and {_share(whole['lost_share'])} of " \
        "pixels lost"  # fmt: skip


def _share(value: float) -> str:
    return f"{value:.1%}" if value < 0.1 else f"{value:.0%}"


def tables(errors: PatternErrors, covers: str) -> tuple[ReportTable, ...]:
    """Patterns by every reading; the same by indenter; and along the path."""
    rows, by_indenter, along = [], [], []
    best = [p for p in errors.printed if (p.recipe.patch_mm, p.recipe.r) in PAPER_BEST]
    chosen = best or errors.printed[:1]
    if (least := errors.best(OURS, "off_dots", errors.printed)) and least not in chosen:
        chosen = [*chosen, least]
    for p in errors.printed:
        row: dict[str, Any] = {
            "pattern": p.label,
            "round": " and ".join(map(str, p.rounds)),
            "paper": p.paper_text.removesuffix(" mm"),
        }
        for method in errors.methods:
            name, whole = SHORT.get(method, method), errors.figures(p.name, method)
            for measure, prefix in MEASURES.items():
                known = errors.mean(p.name, method, measure)
                for end in ("", "_low", "_high"):
                    value = known and getattr(known, end.removeprefix("_") or "value")
                    row[f"{name}_{prefix}mm{end}"] = value
            at_dots = errors.by_indenter(p.name, method, "at_dots")
            row[f"{name}_sum_mm"] = None if at_dots is None else float(at_dots.sum())
            row[f"{name}_lost_frames"] = 1 - whole["trusted_share"]
            row[f"{name}_lost_pixels"] = whole["lost_share"]
            row[f"{name}_coverage"] = whole["coverage"]
            row[f"{name}_renewals"] = whole["reference_switches"]
            if at_dots is not None:
                each = dict(zip(errors.indenters, at_dots.tolist(), strict=True))
                by_indenter.append({"pattern": p.label, "tracker": name, **each})
            if p in chosen:
                along += [{"pattern": p.label, "tracker": name, **one}
                          for one in errors.along(p.name, method)]  # fmt: skip
        rows.append({**row, "dots_lost": _dots_lost(errors, p)})
    shown = ["pattern", "round", "paper"]
    words = {"paper": "the paper, mm", "dots_lost": "dots not found"}
    for method in errors.methods:
        name = SHORT.get(method, method)
        shown += [f"{name}_{key}" for key in KEPT.get(method, ("mm",))]
    return (
        ReportTable(
            "patterns",
            "Each pattern. At the dots (Eq. 7): over all dots, over those that move, and the sum "
            "over indenters, for the paper says neither which dots nor whether its stacked columns "
            "are means; off the dots: all moving visible pixels against the simulated truth. "
            f"Over {covers}.",
            pd.DataFrame(rows),
            tuple(shown),
            words,
        ),
        ReportTable("indenters", f"At the dots, mm, by indenter. Over {covers}.",
                    pd.DataFrame(by_indenter)),
        ReportTable(
            "path",
            "Along the path. Means over frames by depth and length of drag, of the paper's "
            "choices and ours. Deep in the gel a pixel is magnified: 2.2 times at 10 mm.",
            pd.DataFrame(along),
        ),
    )  # fmt: skip


def _dots_lost(errors: PatternErrors, printed: SeriesEntry) -> float | None:
    """Share of the dots that were not found in a frame; None where none was followed."""
    found = [c.dots for c in errors.cells if c.pattern == printed.name and c.dots]
    lost, seen = (sum(dots[key] for dots in found) for key in ("lost", "seen"))
    return lost / (lost + seen) if lost + seen else None


def charts(errors: PatternErrors, covers: str) -> tuple[ReportFigure, ...]:
    """The paper's chart by its tracker in both readings, and ours off the dots."""
    wanted: tuple[tuple[str, Measure, str], ...] = (
        (SUMMED, "at_dots", "at the dots"),
        (COMPOSED, "at_dots", "at the dots"),
        (OURS, "off_dots", "of moving pixels off the dots, against truth"),
        (OURS, "at_dots", "at the dots"),
    )
    return tuple(
        ReportFigure(
            f"{SHORT[method]}-{measure.replace('_', '-')}",
            f"Mean error of {METHODS[method]}, {what}, stacked by indenter; vertical bars: 95 % "
            "intervals over indenters"
            + (
                ""
                if method == OURS
                else "; horizontal lines: the paper's, dashed where it says 'around', an "
                "arrow where it is far above"
            )
            + f". {covers}.",
            partial(_chart, errors, method, measure),
        )
        for method, measure, what in wanted
        if any(errors.mean(p.name, method, measure) for p in errors.printed)
    )


def _chart(errors: PatternErrors, method: str, measure: Measure) -> Figure:
    """The paper's two rounds one below the other: a column a pattern, indenter on indenter."""
    from deltact_fab.present import create_figure, draw_legend, draw_paper_line

    parts, colours = rounds(errors.printed), ReportFigure.SERIES_COLOURS
    figure, axes = create_figure(7.4, 2.6 * len(parts) + 0.6, rows=len(parts), share_y=False)
    for axis, (title, patterns) in zip(axes, parts, strict=True):
        each = [errors.by_indenter(p.name, method, measure) for p in patterns]
        count = len(errors.indenters)
        heights = np.array([np.zeros(count) if m is None else m / len(m) for m in each])
        tops = heights.cumsum(axis=1)
        for k, indenter in enumerate(errors.indenters):
            axis.bar(range(len(patterns)), heights[:, k], 0.62, bottom=tops[:, k] - heights[:, k],
                     label=indenter, color=colours[k % len(colours)])  # fmt: skip
        ends = [errors.mean(p.name, method, measure) for p in patterns]
        highest = max(one.high or one.value for one in ends if one) if any(ends) else 0.0
        words = "the paper"
        for x, (p, one) in enumerate(zip(patterns, ends, strict=True)):
            if one is None:
                axis.annotate("no dots", (x, 0), ha="center", va="bottom", fontsize="small")
            elif one.low is not None and one.high is not None:
                axis.plot([x, x], [one.low, one.high], color=ReportFigure.INK_COLOUR, lw=0.9)
            if method != OURS and p.paper_error_mm is not None:
                draw_paper_line(axis, p.paper_error_mm, highest, words, (x - 0.42, x + 0.42),
                                   p.paper_about)  # fmt: skip
                words = "_"  # the legend names it once
        axis.set_xticks(range(len(patterns)), [p.label.replace(" r", "\nr") for p in patterns])
        axis.set_title(title, loc="left", fontsize="medium", pad=14)
        axis.set_ylabel("mean error, mm")
        axis.grid(visible=False, axis="x")
    draw_legend(figure, axes[0])
    return figure


def rounds(printed: Sequence[SeriesEntry]) -> list[tuple[str, list[SeriesEntry]]]:
    """The paper's two rounds as far as their patterns are here, and the others; none empty."""
    names = ("First round", "Second round")
    found = [
        (f"{names[n - 1]} of the paper", [p for p in printed if n in p.rounds])
        for n in range(1, len(PatternSeries.grids) + 1)
    ]
    found.append(("Other patterns", [p for p in printed if not p.rounds]))
    return [(title, part) for title, part in found if part]
