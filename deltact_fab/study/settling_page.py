"""The settling study's page: tables, headlines, figures and verdict from stops and protocols."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis.relaxation import Series, time_to
from ..protocols.plan import Protocol
from ..report.result import Headline, LeftOut, ReportFigure, ReportTable, StudyResult
from . import intervals, modulus
from . import settling_figures as draw
from .settling_stops import FORCES_N, SHARES, Stop, waits

if TYPE_CHECKING:
    import pandas as pd

    from .request import StudyRequest

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
            + (
                "solved on the viscous gel (points) and in closed form (lines)."
                if simulated_ and not asked.runs
                else "as measured (thin) and by the fitted series (thick)."
            )
            + " Dotted: 5, 2, 1, 0.5 %.",
            partial(draw.curve, stops, series, not asked.runs),
        ),
        ReportFigure(
            "wait-against-gel",
            f"How long to wait for {100 * BOUND:g} % in a gel of one time of relaxation, after a "
            f"ramp of {ramp_s:.2g} s, in closed form: read off your own.",
            partial(draw.sensitivity, ramp_s, BOUND),
            column=True,
        ),
        ReportFigure(
            "protocols",
            "What the stops of the shipped protocols scatter by, the factor common to all of them "
            "taken out, against how long they rest.",
            partial(draw.judged, protocols),
        ),
    )
    return StudyResult(
        "settling", "How long to wait at a stop", _verdict(heads, judged_, series, asked), {
            "prony": [list(pair) for pair in series.pairs],
            "stops": _plain(table), "protocols": _plain(judged_), "simulated": simulated_, **more,
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
         modulus.remark("settling", protocol.specimen.modulus_mpa)),
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
    for kind, words in (("press", "a press"), ("shear", "a drag")):
        own = table[table["kind"] == kind]
        column = f"wait_{100 * BOUND:g}pct_s"
        known = own[np.isfinite(own[column])]
        if not len(known):
            continue
        found = intervals.mean(known[column], list(known["group"]), "depth")
        short = len(own) - len(known)
        heads.append(
            Headline(
                f"Wait after {words} for {100 * BOUND:g} % of the force", found.value, "s",
                None if found.low is None else max(found.low, 0.0), found.high, found.over,
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
    gel = f"the gel fitted to these runs ({words(series)})" if asked.runs else (
        f"a gel of {words(series)} ({ASSUMED})"
    )  # fmt: skip
    lines = [
        f"On {gel} the force is within {100 * BOUND:g} % of its steady value "
        + " and ".join(f"{h.value:.2g} s after {h.what.split(' for ')[0][11:]}" for h in heads
                       if h.what.startswith("Wait")) + "."
    ]  # fmt: skip
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


def _plain(table: pd.DataFrame) -> list[dict[str, Any]]:
    rows = table.to_dict("records")
    return [{str(k): None if v != v else v for k, v in row.items()} for row in rows]
