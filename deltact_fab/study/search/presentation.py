"""Tables and figures of a pattern search."""

from __future__ import annotations

from functools import partial
from typing import Any

from ...report.result import ReportFigure, ReportTable
from . import figures
from .findings import Findings
from .search import PREDICTORS
from .verdict import DEFAULT, ConfirmedPattern

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
NOT_SHOWN = ("column", "over", "patterns")
ORDER_WORDS = {
    "rho": "mean error",
    "low": "from",
    "high": "to",
    "needs_tracker": "needs a tracker",
    "rho_sure": "of the sure",
    "low_sure": "from",
    "high_sure": "to",
    "rho_lost": "not sure of",
    "low_lost": "from",
    "high_lost": "to",
    "rho_gel": "gel",
    "low_gel": "from",
    "high_gel": "to",
}


def tables(found: Findings) -> tuple[ReportTable, ...]:
    import pandas as pd

    rows = [c.as_row() | _by_press(found, c) for c in (*found.ours, *found.farneback)]
    confirmed_rows = pd.DataFrame(rows)
    paper = found.of(found.ours, found.paper)
    if paper is not None:
        shares = [None if c.method != DEFAULT else c.error.value / paper.error.value
                  for c in (*found.ours, *found.farneback)]  # fmt: skip
        confirmed_rows["share_of_paper"] = shares
    columns = (
        "pattern", "error_mm", "coverage", "bridged_mm", "leap_error_mm",
        *(p.column for p in PREDICTORS), "refused",
    )  # fmt: skip
    orders = found.order
    for suffix, other in (
        ("_sure", found.sure_order),
        ("_lost", found.lost_order),
        ("_gel", found.confirmed_order),
    ):
        if other is not None:
            orders = orders.merge(
                other[["predictor", "rho", "low", "high"]],
                on="predictor", how="left", suffixes=("", suffix),
            )  # fmt: skip
    seeds = f"{found.size.seeds} seed{'s' * (found.size.seeds > 1)}"
    out = [
        ReportTable("confirmed", "Confirmed on the finite-strain gel. Means over "
              f"{found.size.held_out} seeds that the search has not seen.", confirmed_rows,
              words=CONFIRMED_WORDS),
        ReportTable("candidates", f"The candidates. Means over {seeds}, best first; of the longest "
              "step that is bridged the least; leap: all of the motion in one step.", found.frame,
              tuple(c for c in columns if c in found.frame),
              WORDS | {p.column: p.words for p in PREDICTORS}),
        ReportTable("predictors", "What orders them. Rank correlation with the candidates' mean "
              "error, with that of the pixels that the tracker is sure of, with the share that it "
              "is not sure of, and with the mean error on the gel where it is known; 1: what it "
              "calls better is better.", orders,
              tuple(str(c) for c in orders if c not in NOT_SHOWN), ORDER_WORDS),
    ]  # fmt: skip
    if found.pair is not None:
        left_out = [
            {"family": name, "picked": " and ".join(names), "rho_within": rho}
            for name, (names, rho) in found.pair.left_out.items()
        ]
        out.append(
            ReportTable("families-left-out", "Two predictors together. By their mean rank, picked "
                  "without the family that they then order.", pd.DataFrame(left_out),
                  words={"rho_within": "rank correlation in it"})
        )  # fmt: skip
    return tuple(out)


def _by_press(found: Findings, one: ConfirmedPattern) -> dict[str, float]:
    """The error of each press, where there are several."""
    if len(found.presses) == 1:
        return {}
    names = (f"{press.replace('/', '-')}_mm" for press in found.presses)
    return dict(zip(names, one.by_press_mm, strict=True))


def drawn(found: Findings) -> tuple[ReportFigure, ...]:
    pictures = _pictures(found)
    words = {found.paper: f"the paper's: {found.paper}"}
    out = [
        ReportFigure("confirmed", "Mean error on the finite-strain gel with its 95 % interval over "
              "the seeds; simulated.",
              partial(figures.confirmed_errors, [c.as_row() for c in found.ours],
                      found.best.pattern, found.paper)),
        ReportFigure("predictors-against-error", "Each predictor against the candidates' error, in "
              f"the search; rings: the paper's and the finalists, {_numbered(found)}.",
              partial(figures.predictors_against_error, found.frame, found.finalists,
                      found.paper)),
        ReportFigure("rank-correlations", "How well each predictor orders the candidates, with its "
              "95 % interval over kinds of pattern: by their mean error, by that of the pixels "
              "that the tracker is sure of, and by the share that it is not sure of.",
              partial(figures.correlations,
                      {"mean error": found.order, "error of the sure": found.sure_order,
                       "share not sure of": found.lost_order})),
    ]  # fmt: skip
    if pictures:
        out.append(
            ReportFigure("seen", "Patterns at rest as the camera sees them.",
                  partial(figures.strip, pictures, words))
        )  # fmt: skip
    return tuple(out)


def _numbered(found: Findings) -> str:
    return ", ".join(f"{i} {name}" for i, name in enumerate(found.finalists, start=1))


def _pictures(found: Findings) -> dict[str, Any]:
    if not found.confirmations:
        return {}
    first = found.confirmations[0][0]
    names = dict.fromkeys((found.best.pattern, *found.finalists[:3], found.paper))
    return {n: first[f"picture/{n}"] for n in names if f"picture/{n}" in first}
