"""Claims, figures, tables and charts of the pattern selection."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from deltact_fab.estimate import Interval
from deltact_fab.fabricate import PatternSeries, SeriesEntry
from deltact_fab.present import Claim, Headline, ReportFigure, ReportTable

from .pattern_errors import COMPOSED_FLOW, FLOW_NAMES, OUR_FLOW, SUMMED_FLOW, Measure, PatternErrors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAPER_BEST = ((0.1, 0.5), (0.075, 0.6))
"""(d in mm, r) of the smallest error in each of the paper's rounds."""
TOO_SMALL_MM, SMALL_D_MM = 0.05, 0.075  # paper: too small to print, and the second round's best
PAGE_COLUMNS = {
    SUMMED_FLOW: ("mm", "moving_mm", "sum_mm", "lost_frames", "lost_pixels"),
    COMPOSED_FLOW: ("mm", "moving_mm", "sum_mm", "lost_pixels"),
    OUR_FLOW: ("mm", "off_mm"),
}
"""Columns shown on the page; the file has all."""
PAPER_FLOWS = (SUMMED_FLOW, COMPOSED_FLOW)
FLOW_LABELS = dict(zip(FLOW_NAMES, ("summed", "composed", "published", "ours"), strict=True))
COLUMN_PREFIX: dict[Measure, str] = {"at_dots": "", "at_moving_dots": "moving_", "off_dots": "off_"}
"""Column prefixes: error at all dots, at moving dots, at moving pixels off the dots."""


def claims(errors: PatternErrors) -> tuple[Claim, ...]:
    """Claims: the paper's best of each round is best here; small patches fail.

    Readings: summed and composed flows. Each pattern of a round is compared with the paper's best,
    so the interval's level is corrected for that many comparisons (Bonferroni).
    """
    all_claims = []
    rounds_ = rounds(errors.printed)[: len(PatternSeries.grids)]
    for number, ((_, part), best) in enumerate(zip(rounds_, PAPER_BEST, strict=False), start=1):
        paper_best = next((p for p in part if (p.recipe.patch_mm, p.recipe.r) == best), None)
        competitors = [p for p in part if p != paper_best]
        if paper_best is None or not competitors:
            continue
        complete = len(part) == math.prod(map(len, PatternSeries.grids[number - 1]))
        level = 1 - 0.05 / len(competitors)
        readings, rivals = {}, []
        for method in PAPER_FLOWS:
            if rival := errors.best(method, "at_dots", competitors):
                rivals.append(rival.label)
                interval = errors.error_ratio([rival.name], [paper_best.name], method, level)
                readings[FLOW_LABELS[method]] = _log_interval(interval)
        round_words = f"round {number} of the paper"
        all_claims.append(
            Claim(
                f"The paper's {paper_best.label} is the best of {round_words}.",
                f"{' and '.join(dict.fromkeys(rivals))} track better than the paper's "
                f"{paper_best.label} in {round_words}.",
                f"Undecided whether the paper's {paper_best.label} is the best of {round_words}.",
                readings if complete else {},
            )
        )
    tiny, small = ([p.name for p in errors.printed if p.recipe.patch_mm == d_mm and 2 in p.rounds]
                   for d_mm in (TOO_SMALL_MM, SMALL_D_MM))  # fmt: skip
    if tiny and small:
        readings = {
            FLOW_LABELS[m]: _log_interval(errors.error_ratio(tiny, small, m)) for m in PAPER_FLOWS
        }
        all_claims.append(
            Claim(
                f"At d {TOO_SMALL_MM:g} mm the error rises, as in the paper.",
                f"At d {TOO_SMALL_MM:g} mm the error does not rise as in the paper.",
                f"Undecided whether the error rises at d {TOO_SMALL_MM:g} mm.",
                readings,
            )
        )
    return tuple(all_claims)


def _log_interval(error_ratio: Interval | None) -> tuple[float | None, float | None]:
    """Logarithms of the ends of a ratio's interval; above 0 if the ratio is above 1."""
    ends = (None, None) if error_ratio is None else (error_ratio.low, error_ratio.high)
    low, high = (None if end is None else math.log(end) for end in ends)
    return low, high


def headlines(errors: PatternErrors) -> tuple[Headline, ...]:
    """Errors of the paper's patterns by tracker, with the paper's; then our smallest."""
    heads = []
    for p in (p for p in errors.printed if p.paper_error_mm is not None and not p.paper_about):
        for method in errors.methods:
            if (interval := errors.mean(p.name, method, "at_dots")) is not None:
                label = f"{p.label}, {FLOW_NAMES.get(method, method)}, at the dots"
                paper_mm = None if method == OUR_FLOW else p.paper_error_mm
                remark = _loss_remark(errors, p, method)
                heads.append(
                    Headline.from_interval(label, "mm", interval, paper=paper_mm, remark=remark)
                )
    best = errors.best(OUR_FLOW, "off_dots", errors.printed)
    if best and (interval := errors.mean(best.name, OUR_FLOW, "off_dots")):
        label = f"least error of {FLOW_NAMES[OUR_FLOW]}, {best.label}, moving pixels off the dots"
        remark = _loss_remark(errors, best, OUR_FLOW)
        heads.append(Headline.from_interval(label, "mm", interval, remark=remark))
    return tuple(heads)


def _loss_remark(errors: PatternErrors, printed: SeriesEntry, method: str) -> str:
    """Remark on lost frames and pixels."""
    total = errors.figures(printed.name, method)
    return f"{_share(1 - total['trusted_share'])} of frames and {_share(total['lost_share'])} of " \
        "pixels lost"  # fmt: skip


def _share(value: float) -> str:
    return f"{value:.1%}" if value < 0.1 else f"{value:.0%}"


def tables(errors: PatternErrors, covers: str) -> tuple[ReportTable, ...]:
    """Tables: patterns by every reading, by indenter, and along the path."""
    rows, by_indenter, along = [], [], []
    best = [p for p in errors.printed if (p.recipe.patch_mm, p.recipe.r) in PAPER_BEST]
    chosen = best or errors.printed[:1]
    if (our_best := errors.best(OUR_FLOW, "off_dots", errors.printed)) and our_best not in chosen:
        chosen = [*chosen, our_best]
    for p in errors.printed:
        row: dict[str, Any] = {
            "pattern": p.label,
            "round": " and ".join(map(str, p.rounds)),
            "paper": p.paper_text.removesuffix(" mm"),
        }
        for method in errors.methods:
            name, total = FLOW_LABELS.get(method, method), errors.figures(p.name, method)
            for measure, prefix in COLUMN_PREFIX.items():
                interval = errors.mean(p.name, method, measure)
                for end in ("", "_low", "_high"):
                    value = interval and getattr(interval, end.removeprefix("_") or "value")
                    row[f"{name}_{prefix}mm{end}"] = value
            at_dots = errors.by_indenter(p.name, method, "at_dots")
            row[f"{name}_sum_mm"] = None if at_dots is None else float(at_dots.sum())
            row[f"{name}_lost_frames"] = 1 - total["trusted_share"]
            row[f"{name}_lost_pixels"] = total["lost_share"]
            row[f"{name}_coverage"] = total["coverage"]
            row[f"{name}_renewals"] = total["reference_switches"]
            if at_dots is not None:
                by_name = dict(zip(errors.indenters, at_dots.tolist(), strict=True))
                by_indenter.append({"pattern": p.label, "tracker": name, **by_name})
            if p in chosen:
                along += [{"pattern": p.label, "tracker": name, **part}
                          for part in errors.along_path(p.name, method)]  # fmt: skip
        rows.append({**row, "dots_lost": _dot_loss(errors, p)})
    columns = ["pattern", "round", "paper"]
    words = {"paper": "the paper, mm", "dots_lost": "dots not found"}
    for method in errors.methods:
        name = FLOW_LABELS.get(method, method)
        columns += [f"{name}_{key}" for key in PAGE_COLUMNS.get(method, ("mm",))]
    return (
        ReportTable(
            "patterns",
            "Each pattern. At the dots (Eq. 7): over all dots, over those that move, and the sum "
            "over indenters (the paper specifies neither the dots nor whether its stacked columns "
            "are means); off the dots: all moving visible pixels against the simulated truth. "
            f"Over {covers}.",
            pd.DataFrame(rows),
            tuple(columns),
            words,
        ),
        ReportTable("indenters", f"At the dots, mm, by indenter. Over {covers}.",
                    pd.DataFrame(by_indenter)),
        ReportTable(
            "path",
            "Along the path. Means over frames by depth and drag length, of the paper's best "
            "and ours. Deep in the gel a pixel is magnified: 2.2 times at 10 mm.",
            pd.DataFrame(along),
        ),
    )  # fmt: skip


def _dot_loss(errors: PatternErrors, printed: SeriesEntry) -> float | None:
    """Share of dots not found in a frame; None if no dots were tracked."""
    counts = [c.dots for c in errors.cells if c.pattern == printed.name and c.dots]
    n_lost, n_seen = (sum(dots[key] for dots in counts) for key in ("lost", "seen"))
    return n_lost / (n_lost + n_seen) if n_lost + n_seen else None


def charts(errors: PatternErrors, covers: str) -> tuple[ReportFigure, ...]:
    """Charts: the paper's tracker in both readings and as published, and ours."""
    specs: tuple[tuple[str, Measure, str], ...] = (
        *((method, "at_dots", "at the dots") for method in FLOW_NAMES),
        (OUR_FLOW, "off_dots", "of moving pixels off the dots, against truth"),
    )
    return tuple(
        ReportFigure(
            f"{FLOW_LABELS[method]}-{measure.replace('_', '-')}",
            f"Mean error of {FLOW_NAMES[method]}, {place}, stacked by indenter; vertical bars: "
            "95 % intervals over indenters"
            + (
                ""
                if method == OUR_FLOW
                else "; horizontal lines: the paper's, dashed if given as 'around', an arrow if "
                "far above"
            )
            + f". {covers}.",
            partial(_chart, errors, method, measure),
        )
        for method, measure, place in specs
        if any(errors.mean(p.name, method, measure) for p in errors.printed)
    )


def _chart(errors: PatternErrors, method: str, measure: Measure) -> Figure:
    """The paper's two rounds: a column per pattern, indenters stacked."""
    from deltact_fab.present import create_figure, draw_legend, draw_paper_line

    parts, colours = rounds(errors.printed), ReportFigure.SERIES_COLOURS
    figure, axes = create_figure(7.4, 2.6 * len(parts) + 0.6, rows=len(parts), share_y=False)
    for axis, (title, patterns) in zip(axes, parts, strict=True):
        per_pattern = [errors.by_indenter(p.name, method, measure) for p in patterns]
        count = len(errors.indenters)
        heights = np.array([np.zeros(count) if m is None else m / len(m) for m in per_pattern])
        tops = heights.cumsum(axis=1)
        for k, indenter in enumerate(errors.indenters):
            axis.bar(range(len(patterns)), heights[:, k], 0.62, bottom=tops[:, k] - heights[:, k],
                     label=indenter, color=colours[k % len(colours)])  # fmt: skip
        ends = [errors.mean(p.name, method, measure) for p in patterns]
        highest = max(m.high or m.value for m in ends if m) if any(ends) else 0.0
        words = "the paper"
        for x, (p, mean) in enumerate(zip(patterns, ends, strict=True)):
            if mean is None:
                axis.annotate("no dots", (x, 0), ha="center", va="bottom", fontsize="small")
            elif mean.low is not None and mean.high is not None:
                axis.plot([x, x], [mean.low, mean.high], color=ReportFigure.INK_COLOUR, lw=0.9)
            if method != OUR_FLOW and p.paper_error_mm is not None:
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
    """Group patterns by the paper's two rounds, and others; no empty groups."""
    names = ("First round", "Second round")
    parts = [
        (f"{names[n - 1]} of the paper", [p for p in printed if n in p.rounds])
        for n in range(1, len(PatternSeries.grids) + 1)
    ]
    parts.append(("Other patterns", [p for p in printed if not p.rounds]))
    return [(title, part) for title, part in parts if part]
