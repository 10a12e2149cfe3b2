"""Tables, charts and plain data of the pattern selection."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from ..patterns.series.job import GRIDS
from ..report.result import ReportFigure, ReportTable
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
    import pandas as pd

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
    from ..report.selection_figures import PatternColumn, stacked

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
