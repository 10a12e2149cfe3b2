"""The settling study's page: tables, headlines, figures and verdict from stops and protocols."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis.relaxation import Series, time_to
from ..protocols.plan import Protocol
from ..report import figures
from ..report.result import Headline, LeftOut, ReportFigure, ReportTable, StudyResult, records
from . import gel_remarks, intervals
from .intervals import headline
from .settling_stops import FORCES_N, SHARES, Stop, waits

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .request import StudyRequest


MIN_PCT = 0.05
MIN_N = 1e-4
TOTALS = (0.05, 0.1, 0.2, 0.4)


def curve(stops: Sequence[Stop], marks: bool) -> Figure:
    """Error against waiting time, a panel for presses and one for drags.

    marks: the stops' own values are points (solved knots), else a line (samples).
    """
    figure, axes = figures.blank(9.6, 3.8, 2)
    own = {"marker": "o", "ms": 3, "ls": ""} if marks else {"lw": 0.6, "alpha": 0.5}
    for axis, kind, words in zip(axes, ("press", "shear"), ("after a press", "after a drag"),
                                 strict=True):  # fmt: skip
        first: dict[float, Stop] = {}
        for stop in stops:
            if stop.kind == kind:
                first.setdefault(stop.depth_mm, stop)
        for colour, stop in zip(cycle(figures.COLOURS), first.values(), strict=False):
            later = stop.wait_s > 0
            wait, steady = stop.wait_s[later], stop.steady / 100
            axis.plot(wait, stop.excess_n()[later] / steady, color=colour,
                      label=f"{stop.depth_mm:g} mm", **own)  # fmt: skip
            axis.plot(wait, stop.excess_by_series_n()[later] / steady, color=colour, lw=1.4)
        for share in SHARES:
            axis.axhline(100 * share, color=figures.PAPER_COLOUR, lw=0.6, ls=":")
        _logarithmic(axis, "wait, s", words)
    axes[0].set_ylabel("force over its steady value, %")
    axes[0].set_ylim(bottom=max(axes[0].get_ylim()[0], MIN_PCT))
    figures.legend_below(figure, axes[0])
    return figure


def _logarithmic(axis: Axes, along: str, title: str = "") -> None:
    axis.set(xscale="log", yscale="log", xlabel=along)
    axis.set_title(title, loc="left", fontweight="bold")


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
    _logarithmic(axis, "time of relaxation, s")
    axis.set(ylim=(0.02, None), ylabel=f"wait for {100 * share:g} %, s")
    figures.legend_below(figure, axis)
    return figure


def judged(tables: dict[str, list[dict[str, float]]]) -> Figure:
    """What a protocol's stops scatter by, against how long they rest."""
    figure, axes = figures.blank(9.6, 3.4, 2)
    for axis, column, words in zip(
        axes, ("normal_scatter_n", "shear_scatter_n"), ("normal force", "shear"), strict=True
    ):
        for colour, (name, rows) in zip(cycle(figures.COLOURS), tables.items(), strict=False):
            tried = sorted((row["settle_s"], row[column]) for row in rows)
            rest, scatter = np.array(tried).T
            if scatter.max() > MIN_N:
                axis.plot(rest, scatter, color=colour, lw=1.4, label=name)
        _logarithmic(axis, "settle_s, s", words)
    axes[0].set(ylabel="scatter among the stops, N", ylim=(MIN_N, None))
    figures.legend_below(figure, axes[0])
    return figure


ASSUMED = "assumed: no relaxation of Solaris was found measured"
BOUND = 0.02  # of the headlines, of the steady force
WAIT_WORDS = {
    "depth_mm": "depth, mm",
    "steady_n": "steady, N",
    "at_once_n": "at once, N",
    "at_once_pct": "at once, %",
    **{f"wait_{100 * share:g}pct_s": f"{100 * share:g} %, s" for share in SHARES},
    **{f"wait_{bound:g}n_s": f"{bound:g} N, s" for bound in FORCES_N},
}
PROTOCOL_WORDS = {
    "settle_s": "settle_s, s",
    "worst_n": "worst, N",
    "worst_pct": "worst, %",
    "normal_bias_pct": "normal, common, %",
    "normal_scatter_n": "normal, scatter, N",
    "shear_bias_pct": "shear, common, %",
    "shear_scatter_n": "shear, scatter, N",
    f"settle_for_{100 * BOUND:g}pct_s": f"settle_s for {100 * BOUND:g} %, s",
}


def result(
    asked: StudyRequest, stops: Sequence[Stop], series: Series, protocol: Protocol,
    protocols: dict[str, list[dict[str, float]]], notes: list[str], settings: dict[str, str],
    *, simulated_: bool, missing: tuple[str, ...], more: dict[str, Any],
    heads: tuple[Headline, ...] = (),
) -> StudyResult:  # fmt: skip
    table = _stop_table(stops)
    heads = (*_headlines(table), *heads)
    judged_ = _protocol_table(protocols)
    ramp_s = max(protocol.depths_mm) / (protocol.motion.press_feed_mm_min / 60)
    figures = (
        ReportFigure(
            "error-against-wait",
            "Force over its steady value against the wait, by depth: "
            "as solved on the viscous gel (points) or measured (thin), and by the series in closed "
            "form (thick). Dotted: 5, 2, 1, 0.5 %.",
            partial(curve, stops, not asked.runs),
        ),
        ReportFigure(
            "wait-against-gel",
            f"How long to wait for {100 * BOUND:g} % in a gel of one time of relaxation, after a "
            f"ramp of {ramp_s:.2g} s, in closed form: read off your own.",
            partial(sensitivity, ramp_s, BOUND),
            column=True,
        ),
        ReportFigure(
            "protocols",
            "What the stops of the shipped protocols scatter by, the factor common to all of them "
            "taken out, against how long they rest.",
            partial(judged, protocols),
        ),
    )
    return StudyResult(
        "settling", "How long to wait at a stop", _verdict(heads, judged_, series, asked), {
            "prony": [list(pair) for pair in series.pairs],
            "stops": records(table), "protocols": records(judged_), "simulated": simulated_, **more,
        },
        simulated_, asked.seed, asked.scale, heads,
        (
            ReportTable("waits", "Seconds of rest until the force is within a bound of its steady "
                  "value. Empty: the rest was too short to tell.", table, words=WAIT_WORDS),
            ReportTable("protocols", "The shipped protocols with their settle_s, largest ball, on "
                  "a gel of this series. A common factor goes into a calibration's "
                  "coefficients; scatter is left as error.", judged_, words=PROTOCOL_WORDS),
        ),
        figures, settings,
        (*notes, "Nothing is drawn at random: the seed does not matter.",
         gel_remarks.remark("settling", protocol.specimen.modulus_mpa)),
        (LeftOut("softening by the first press (Mullins)", "the gel has no such memory; press a "
                 "new gel as deep before you measure"),
         LeftOut("drift of the force sensor", "looks like a slow branch; see the force after the "
                 "press")),
        missing,
    )  # fmt: skip


def _stop_table(stops: Sequence[Stop]) -> pd.DataFrame:
    import pandas as pd

    rows = []
    for stop in stops:
        excess = stop.excess_n()
        rows.append(
            {"stop": stop.name, "kind": stop.kind, "depth_mm": stop.depth_mm, "group": stop.group,
             "steady_n": stop.steady, "at_once_n": float(excess[0]),
             "at_once_pct": float(100 * excess[0] / stop.steady), **waits(stop)}
        )  # fmt: skip
    return pd.DataFrame(rows)


def _headlines(table: pd.DataFrame) -> tuple[Headline, ...]:
    heads = []
    column = f"wait_{100 * BOUND:g}pct_s"
    for kind, words in (("press", "a press"), ("shear", "a drag")):
        own = table[table["kind"] == kind]
        known = own[np.isfinite(own[column])]
        if not len(known):
            continue
        found = intervals.mean(known[column], list(known["group"]), "depth")
        if found.low is not None:
            found = found._replace(low=max(found.low, 0.0))
        short = len(own) - len(known)
        heads.append(
            headline(
                f"Wait after {words} for {100 * BOUND:g} % of the force", "s", found,
                remark=f"{short} stops rested too short to tell" if short else "",
            )
        )  # fmt: skip
    return tuple(heads)


def _protocol_table(protocols: dict[str, list[dict[str, float]]]) -> pd.DataFrame:
    import pandas as pd

    rows = []
    for name, table in protocols.items():
        own, tried = table[0], table[1:]
        rests, worst = ([row[key] for row in tried] for key in ("settle_s", "worst_pct"))
        enough = {f"settle_for_{100 * BOUND:g}pct_s": time_to(rests, worst, 100 * BOUND)}
        rows.append({"protocol": name, **own, **enough})
    return pd.DataFrame(rows)


def _verdict(
    heads: Sequence[Headline], protocols: pd.DataFrame, series: Series, asked: StudyRequest
) -> tuple[str, ...]:
    source = "fitted to these runs" if asked.runs else ASSUMED
    waits_s = [h for h in heads if h.what.startswith("Wait")]
    said = " and ".join(f"{h.value:.2g} s after {h.what.split(' for ')[0][11:]}" for h in waits_s)
    lines = [
        f"On a gel of {words(series)} ({source}) the force is within {100 * BOUND:g} % of its "
        f"steady value {said}."
    ]
    of = protocols[protocols["protocol"] == "force-calibration"] if len(protocols) else protocols
    if len(of):
        row = of.iloc[0]
        lines.append(
            f"force-calibration rests {row['settle_s']:g} s at a stop: its forces are still up to "
            f"{row['worst_pct']:.2g} % off. {row['normal_bias_pct']:.2g} % of the normal force is "
            "common to all stops and goes into the coefficients; what is left scatters by "
            f"{row['normal_scatter_n']:.2g} N normal and {row['shear_scatter_n']:.2g} N in shear "
            "(the paper's whole RMSE: 0.3 and 0.14 to 0.17 N)."
        )
    return tuple(lines)


def words(series: Series) -> str:
    return ", ".join(f"{100 * g:.2g} % in {tau:.2g} s" for g, tau in series.pairs)
