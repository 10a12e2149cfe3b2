"""Offline HTML pages of the engine benchmark and of a rehearsal."""

from __future__ import annotations

import json
import textwrap
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from deltact_fab.common import Check, graded, html_table, write_page, write_whole

from . import figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STABILITY_COLUMNS = ["case", "outcome", "expectation", "figure", "bound", "unit", "note"]


def write_numerics_page(data: dict[str, Any], out: Path) -> Path:
    """Write the page of `Numerics.as_dict()` to one self-contained file.

    Raises MissingLibrary without the extra `report`, RunFailed when the disk refuses.
    """
    engines = []
    for engine in data["engines"]:
        curves = [r for r in data["curves"] if r["engine"] == engine["name"]]
        by_case = {r["case"]: [s for s in curves if s["case"] == r["case"]] for r in curves}
        cases = [r for r in data["stability"] if r["engine"] == engine["name"]]
        cells = [r for r in data["extremes"] if r["engine"] == engine["name"]]
        charts = {r["chart"]: [s for s in cells if s["chart"] == r["chart"]] for r in cells}
        engines.append(
            {
                **engine,
                "panels": [figures.to_svg(error_against_time(rows)) for rows in by_case.values()],
                "against": [
                    f"{rows[0]['reference']} ({rows[0]['kind']}; {case})"
                    for case, rows in by_case.items()
                ],
                "charts": [figures.to_svg(extremes_chart(rows)) for rows in charts.values()],
                "cells": Counter(r["outcome"] for r in cells),
                "stability": html_table(
                    pd.DataFrame(cases, columns=STABILITY_COLUMNS),
                    marks=["bad" if r["outcome"] == "wrong" else "" for r in cases],
                ),
                "counts": Counter(r["outcome"] for r in cases),
            }
        )  # fmt: skip
    checks = [_stability_check(data["stability"] + data["extremes"])]
    if stale := data["meta"]["map"]["stale"]:
        text = f"The stored map of {', '.join(stale)} is of other code than the one here."
        checks.append(Check("map", value=text, status="warn"))
    return write_page(out, "numerics.html", checks, engines=engines, meta=data["meta"])


CELL_STYLES = {
    "right": ("#8fce9b", ""), "flagged": ("#f4cf62", "flag"), "refused": ("#c3c8d1", "no"),
    "wrong": ("#e0574f", "wrong"),
}  # fmt: skip
"""Colour and word of an outcome; a right one shows its figure."""


def extremes_chart(rows: Sequence[dict[str, Any]]) -> Figure:
    """Draw a chart of the map of extremes: a square per cell, framed if computed anew.

    rows: of one chart. A figure in brackets is what is stated, without an outside answer.
    """
    names, columns = (list(dict.fromkeys(r[key] for r in rows)) for key in ("row", "column"))
    height = 1.0 + 0.3 * len(names)
    figure, (axis,) = figures.create_figure(2.4 + 0.62 * len(columns), height)
    axis.grid(visible=False)
    for row in rows:
        x, y = columns.index(row["column"]), names.index(row["row"])
        colour, words = CELL_STYLES[row["outcome"]]
        if row["outcome"] == "right":
            size = abs(row["figure"])
            words = f"{size:.1g}" if size < 0.01 else f"{size:.2g}"
            words = words if row["outside"] else f"({words})"
        axis.barh(y, 0.94, 0.9, x - 0.47, color=colour, lw=1.6,
                  edgecolor=figures.INK_COLOUR if row["anew"] else colour)  # fmt: skip
        axis.text(x, y, words, ha="center", va="center", color="#1c2430", fontsize=8.5)
    axis.set_xticks(range(len(columns)), columns, rotation=35 if len(columns) > 4 else 0)
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.tick_params(length=0)
    for side in ("left", "bottom"):
        axis.spines[side].set_visible(False)
    title = textwrap.fill(rows[0]["chart"], 14 + 8 * len(columns))
    figure.suptitle(title, x=0.01, ha="left", fontweight="bold", fontsize=9.5)
    return figure


def _stability_check(rows: Sequence[dict[str, Any]]) -> Check:
    """Verdict on the stiff and extreme cases, stored ones included."""
    wrong, n = [r["case"] for r in rows if r["outcome"] == "wrong"], len(rows)
    stored = sum(not r.get("anew", True) for r in rows)
    if wrong:
        are = "is" if len(wrong) == 1 else "are"
        text = f"{len(wrong)} of {n} stiff and extreme cases {are} wrong: {'; '.join(wrong)}."
        return Check("cases", value=f"{text} Do not trust results of these engines.", status="fail")
    return Check(
        "cases",
        value=f"{n}/{n} stiff and extreme cases passed ({stored} stored, {n - stored} computed for "
        "this page): right within their bounds, flagged, or refused. The engines can be trusted "
        "within the errors below; one against a finer self shows convergence, not accuracy, and is "
        "never on the front.",
    )


def error_against_time(rows: Sequence[dict[str, Any]]) -> Figure:
    """Plot error against CPU time of one case, log-log, a line per series, Pareto front ringed.

    Marks at the best time; bars to the slowest.
    """
    figure, (axis,) = figures.create_figure(5.0, 4.4)
    valid = [r for r in rows if r["error"] is not None and r["error"] > 0]
    names = []
    for i, name in enumerate(dict.fromkeys(r["series"] for r in rows)):
        part = sorted((r for r in valid if r["series"] == name), key=lambda r: r["cpu_s"])
        best, slowest = ([r[key] * 1e3 for r in part] for key in ("cpu_s", "cpu_most_s"))
        errors = [r["error"] for r in part]
        colour = figures.SERIES_COLOURS[i % len(figures.SERIES_COLOURS)]
        # Names with a number are values of one parameter and are joined; methods are not.
        ladder = all(any(c.isdigit() for c in r["setting"]) for r in part)
        axis.plot(best, errors, marker=figures.SERIES_MARKERS[i % len(figures.SERIES_MARKERS)],
                  color=colour, ms=6, lw=1.0, ls="-" if ladder else "none", label=name)  # fmt: skip
        axis.hlines(errors, best, slowest, color=colour, lw=2.5, alpha=0.25)
        labels = [r["setting"] + (" (default)" if r["recommended"] else "") for r in part]
        names += [(*mark, colour) for mark in zip(best, errors, labels, strict=True)]
    front = sorted((r for r in valid if r["pareto"]), key=lambda r: r["cpu_s"])
    axis.plot([r["cpu_s"] * 1e3 for r in front], [r["error"] for r in front], "o:", ms=12,
              lw=0.9, color=figures.SOFT_COLOUR, mfc="none", mew=1.1, label="Pareto front",
              zorder=1)  # fmt: skip
    figures.set_log_scale(axis, "xy")
    if valid:  # room for the names, and at least one tick on each axis
        axis.set_xlim(
            min(r["cpu_s"] for r in valid) * 1e3 / 1.6, max(r["cpu_most_s"] for r in valid) * 2.8e3
        )
        axis.set_ylim(min(r["error"] for r in valid) / 1.8, max(r["error"] for r in valid) * 2.2)
    axis.set_xlabel("CPU time, ms: best of the runs, bar to the slowest")
    axis.set_ylabel(f"error, {rows[0]['unit']}")
    title = textwrap.fill(rows[0]["case"], 52)
    axis.set_title(title, loc="left", fontweight="bold", fontsize=9.5)
    figure.legend(loc="outside lower left", fontsize="small", ncols=2)
    figures.name_marks(figure, axis, names)
    return figure


FAULT_COLUMNS = {
    "fault": "fault", "moment": "when", "outcome": "message to the operator",
    "deeper_mm": "lower, mm", "wrong": "with --resume",
}  # fmt: skip


def write_rehearsal_page(report: dict[str, Any], protocol: str, rig: str, out: Path) -> list[Path]:
    """Write rehearsal.html and .json of `Rehearsal.as_dict()` into a folder; return the files."""
    rows = [{**c, "wrong": c["wrong"] or "same record"} for c in report["cells"]]
    marks = ["" if c["passed"] else "bad" for c in rows]
    frame = pd.DataFrame(rows, columns=list(FAULT_COLUMNS)).round(2)
    cells = html_table(frame, FAULT_COLUMNS, marks)
    text = f"{report['verdict'][:1].upper()}{report['verdict'][1:]}."
    check = Check("faults", value=text, status=graded(report["passed"]))
    page, data = out / "rehearsal.html", out / "rehearsal.json"
    write_page(
        page, "rehearsal.html", [check], report=report, protocol=protocol, rig=rig, cells=cells
    )
    write_whole(data, json.dumps(report, indent=1).encode())
    return [page, data]
