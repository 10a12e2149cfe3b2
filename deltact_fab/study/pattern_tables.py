"""Tables, charts and plain data of the pattern selection."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import pandas as pd

from ..patterns.series.job import GRIDS
from ..report.result import Headline, ReportFigure, ReportTable
from .intervals import headline, told
from .pattern_errors import Measure, PatternErrors, PrintedPattern

if TYPE_CHECKING:
    from matplotlib.figure import Figure


TRACKERS = {"paper": "the paper's tracker", "fused": "our tracker"}
MEASURES: dict[Measure, str] = {
    "at_dots": "at the dots, as the paper has it",
    "off": "moving pixels off the dots, against truth",
}
KEYS: dict[Measure, str] = {"at_dots": "at_dots_mm", "off": "off_dots_mm"}


def data_of(errors: PatternErrors) -> dict[str, Any]:
    """All figures as plain data: patterns, each by tracker, by indenter and by depth; the best."""
    return {
        "patterns": [
            {
                "name": p.name,
                "d_mm": p.d_mm,
                "r": p.r,
                "rounds": list(p.rounds),
                "paper_error_mm": p.paper_mm,
                "paper_about": p.paper_about,
                "dots_lost_share": dots_lost(errors, p),
                "trackers": {m: _tracker(errors, p, m) for m in errors.methods},
            }
            for p in errors.printed
        ],
        "best": {
            m: {
                KEYS[measure]: (best.name if (best := errors.best(m, measure)) else None)
                for measure in MEASURES
            }
            for m in errors.methods
        },
    }


def dots_lost(errors: PatternErrors, printed: PrintedPattern) -> float | None:
    """Share of the dots that were not found in a frame; None where none was followed."""
    found = [c.dots for c in errors.cells if c.pattern == printed.name and c.dots]
    lost, seen = (sum(dots[key] for dots in found) for key in ("lost", "seen"))
    return lost / (lost + seen) if lost + seen else None


def _tracker(errors: PatternErrors, printed: PrintedPattern, method: str) -> dict[str, Any]:
    whole = errors.tally(printed.name, method).figures()
    found: dict[str, Any] = {}
    for measure, key in KEYS.items():
        known = errors.over_indenters(printed.name, method, measure)
        found[key] = (
            None if known is None else {"value": known.value, "low": known.low, "high": known.high}
        )
    for key in (
        "p95_off_dots_mm", "p95_off_dots_beyond_mm", "mean_confident_mm", "coverage",
        "confident_wrong_share", "peak_true_mm", "n_frames", "reference_switches",
    ):  # fmt: skip
        found[key] = whole[key]
    return found | {
        "by_indenter": {
            i: {
                **{KEYS[m]: errors.mean_mm(printed.name, method, m, i) for m in MEASURES},
                "coverage": errors.tally(printed.name, method, i).figures()["coverage"],
            }
            for i in errors.indenters
        },
        "by_depth": errors.by_depth(printed.name, method),
    }


def tables(
    errors: PatternErrors, part: dict[str, Any] | None, covers: str
) -> tuple[ReportTable, ...]:
    """Patterns; and the same by indenter and by depth. part: of the path, a column each."""
    rows, by_indenter, by_depth = [], [], []
    path = {} if part is None else {
        key: part[key] for key in ("positions", "shear_mm", "frames_share", "longest_step_mm")
    }  # fmt: skip
    for p in errors.printed:
        about: dict[str, Any] = {"pattern": p.words, "d_mm": p.d_mm, "r": p.r}
        row = about | {
            "round": " and ".join(str(n) for n in p.rounds),
            "paper_mm": p.paper_mm,
            "paper": "" if p.paper_mm is None else f"{'about ' * p.paper_about}{p.paper_mm:g}",
        }
        for method in errors.methods:
            found = _tracker(errors, p, method)
            for key in KEYS.values():
                for end in ("value", "low", "high"):
                    name = f"{method}_{key}" if end == "value" else f"{method}_{key}_{end}"
                    row[name] = found[key] and found[key][end]
            for key in ("p95_off_dots_mm", "coverage", "confident_wrong_share",
                        "reference_switches"):  # fmt: skip
                row[f"{method}_{key}"] = found[key]
            for indenter, held in found["by_indenter"].items():
                by_indenter.append(
                    {**about, "tracker": method, "indenter": indenter, **held, **path}
                )
            for depth_mm, held in found["by_depth"].items():
                by_depth.append(
                    {**about, "tracker": method, "depth_mm": float(depth_mm), **held, **path}
                )
        rows.append({**row, "dots_lost_share": dots_lost(errors, p), **path})
    shown = [f"{m}_{key}" for m in errors.methods for key in (*KEYS.values(), "coverage")]
    words = {f"{m}_{key}": f"{TRACKERS.get(m, m)}, {what}: {covers}"
             for m in errors.methods
             for key, what in (("at_dots_mm", "error at the dots, mm"),
                               ("off_dots_mm", "error off the dots, mm"),
                               ("coverage", "share confident"))}  # fmt: skip
    return (
        ReportTable(
            "patterns",
            "Mean tracking error of each pattern. At the dots it is the paper's (Eq. 7); off the "
            "dots it is that of all moving visible pixels against the simulated truth. "
            f"All of it over {covers}.",
            pd.DataFrame(rows),
            ("pattern", "round", "paper", *shown, "dots_lost_share"),
            {"paper": "the paper, mm", "dots_lost_share": "dots not found"} | words,
        ),
        ReportTable(
            "indenters",
            f"The same by indenter. Over {covers}.",
            pd.DataFrame(by_indenter),
        ),
        ReportTable(
            "depths",
            "The same by depth, means over frames. Summed flow keeps the errors of all frames "
            f"before, so the second depth has those of the first. Over {covers}.",
            pd.DataFrame(by_depth),
        ),
    )


def charts(errors: PatternErrors, covers: str) -> tuple[ReportFigure, ...]:
    """The paper's chart, for each tracker and measure that was taken."""
    return tuple(
        ReportFigure(
            f"{method}-{KEYS[measure].removesuffix('_mm').replace('_', '-')}",
            f"Mean error of {TRACKERS.get(method, method)}, {what}, indenter on indenter; upright: "
            f"95 % over indenters; across: the paper's, dashed where it says 'around'. {covers}.",
            partial(_chart, errors, method, measure),
        )
        for method in errors.methods
        for measure, what in MEASURES.items()
        if any(errors.over_indenters(p.name, method, measure) for p in errors.printed)
    )


def _chart(errors: PatternErrors, method: str, measure: Measure) -> Figure:
    from ..report.paper_charts import PatternColumn, stacked

    def column(p: PrintedPattern) -> PatternColumn:
        whole = errors.over_indenters(p.name, method, measure)
        means = [errors.mean_mm(p.name, method, measure, i) for i in errors.indenters]
        return PatternColumn(
            p.words.replace(" r", "\nr"),
            tuple(None if v is None else v / len(means) for v in means),
            whole.low if whole else None,
            whole.high if whole else None,
            p.paper_mm,
            p.paper_about,
        )

    panels = [(title, [column(p) for p in part]) for title, part in rounds(errors.printed)]
    return stacked(panels, errors.indenters)


def rounds(printed: Sequence[PrintedPattern]) -> list[tuple[str, list[PrintedPattern]]]:
    """The paper's two rounds as far as their patterns are here, and the others; none empty."""
    names = ("First round", "Second round")
    found = [
        (f"{names[n - 1]} of the paper", [p for p in printed if n in p.rounds])
        for n in range(1, len(GRIDS) + 1)
    ]
    found.append(("Other patterns", [p for p in printed if not p.rounds]))
    return [(title, part) for title, part in found if part]


PAPER_BEST = ((0.1, 0.5), (0.075, 0.6))
"""(d in mm, r) of the least error in each of the paper's rounds."""
TOO_SMALL_MM, SMALL_MM = 0.05, 0.075


def verdict(errors: PatternErrors, covers: str, bench: str = "") -> tuple[str, ...]:
    """Sentences, the answer first. bench: of a simulated one in figures, empty for a real one."""
    if not any(errors.best(m, "at_dots") for m in errors.methods):
        return ("No pattern has an error under every indenter: nothing can be compared.",)
    lines = [_optimum(errors), *(_of(errors, m) for m in errors.methods)]
    tiny, small = (_mean_of(errors, d_mm, "paper") for d_mm in (TOO_SMALL_MM, SMALL_MM))
    if tiny is not None and small is not None:
        lines.append(
            f"At d = {TOO_SMALL_MM:g} mm, where the paper's error rises to around 0.5 mm, it is "
            f"{tiny:.3g} mm here, and {small:.3g} mm at {SMALL_MM:g} mm (means of r .4 to .6)."
        )
    if "paper" in errors.methods:
        counts = [errors.tally(p.name, "paper").switches for p in errors.printed]
        lines.append(
            f"The paper's tracker renewed its reference {min(counts)} to {max(counts)} times a "
            f"pattern in {len({cell.press for cell in errors.cells})} presses, and each time "
            "keeps that frame's error for good, whatever the pattern."
        )
    return (*filter(None, [*lines, bench]), f"{'Simulated: ' if bench else ''}{covers}.")


def _optimum(errors: PatternErrors) -> str:
    """Whether the paper's best of each round is the best here, by its own tracker and error."""
    method = "paper" if "paper" in errors.methods else errors.methods[0]
    said, appears = [], "appears"
    for (_, part), (d_mm, r) in zip(rounds(errors.printed), PAPER_BEST, strict=False):
        theirs = next((p for p in part if (p.d_mm, p.r) == (d_mm, r)), None)
        best = errors.best(method, "at_dots", part)
        here = theirs and errors.over_indenters(theirs.name, method, "at_dots")
        least = best and errors.over_indenters(best.name, method, "at_dots")
        if theirs is None or best is None or not here or not least or len(part) < 2:
            continue
        if best == theirs:
            said.append(f"{theirs.words} is the best of its round ({told(here, 'mm')})")
            continue
        appears = "does not appear"
        apart = errors.difference(theirs.name, best.name, method, "at_dots")
        sure = apart is not None and apart.low is not None and apart.low > 0
        said.append(
            f"{best.words} ({told(least, 'mm')}) comes before {theirs.words} ({told(here, 'mm')}) "
            f"in its round{'' if sure else ', which the indenters do not tell apart'}"
        )
    line = f"The paper's optimum {appears} by its own tracker and error: {'; '.join(said)}."
    return line if said else ""


def _of(errors: PatternErrors, method: str) -> str:
    parts = []
    for measure, words in MEASURES.items():
        best = errors.best(method, measure)
        known = best and errors.over_indenters(best.name, method, measure)
        if best is None or not known:
            continue
        others, cover = len(errors.beside(best, method, measure)), _covered(errors, best, method)
        parts.append(
            f"{words}, best with {best.words}: {told(known, 'mm')}{cover and f', {cover}'}; "
            f"{others} others are not told from it"
        )
    return f"By {TRACKERS.get(method, method)}: {'; '.join(parts)}." if parts else ""


def _covered(errors: PatternErrors, printed: PrintedPattern, method: str) -> str:
    """What a tracker is confident of, in words; empty where that is not known."""
    cover = errors.tally(printed.name, method).figures()["coverage"]
    return "" if cover is None else f"confident of {cover:.0%} of the moving pixels"


def _mean_of(errors: PatternErrors, d_mm: float, method: str) -> float | None:
    """Mean error at the dots over the second round's patterns of a patch size."""
    values = [
        errors.over_indenters(p.name, method, "at_dots")
        for p in errors.printed
        if p.d_mm == d_mm and 2 in p.rounds
    ]
    known = [v.value for v in values if v is not None]
    return sum(known) / len(known) if known and len(known) == len(values) else None


def headlines(errors: PatternErrors) -> tuple[Headline, ...]:
    """The paper's figures beside those found, by its tracker; then ours."""
    wanted: list[tuple[PrintedPattern, str, Measure, float | None, str]] = []
    for method in errors.methods:
        wanted += [
            (p, method, "at_dots", p.paper_mm, "")
            for p in errors.printed
            if p.paper_mm is not None and not p.paper_about
        ]
        bests = ((errors.best(method, measure), measure) for measure in MEASURES)
        wanted += [(p, method, measure, None, "best: ") for p, measure in bests if p is not None]
    found = []
    for p, method, measure, paper_mm, head in wanted:
        known = errors.over_indenters(p.name, method, measure)
        if known is not None:
            what = f"{head}{p.words}, {TRACKERS.get(method, method)}, {MEASURES[measure]}"
            remark = _covered(errors, p, method)
            found.append(headline(what, "mm", known, paper=paper_mm, remark=remark))
    return tuple(dict.fromkeys(found))
