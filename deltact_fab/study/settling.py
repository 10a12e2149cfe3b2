"""How long to wait at a stop: the force's error against the wait, on the viscous gel or a bench's.

Simulated: the protocol `settling` with rests until nothing is left, each depth a job, on the
viscous gel and (for the closed form) on the elastic one. Recorded: the rests of runs, and the
series that fits them. Both give stops, and from there on it is one study.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import catalog, record
from ..analysis.relaxation import Fitted, Rest, Series, fit, rests
from ..cad.design import load_design
from ..errors import InputError
from ..protocols import plan
from ..protocols.plan import Protocol
from ..report.result import Drawn, Headline, LeftOut, StudyResult, Table
from ..rig import config as rig_config
from ..rig.config import VirtualConfig
from . import intervals, modulus
from . import settling_figures as draw
from .grid import Job
from .settling_gel import follow
from .settling_stops import SHARES, WAITS_S, Stop, judged, simulated, waits

if TYPE_CHECKING:
    import pandas as pd

    from .asked import Asked

PROTOCOL = "settling"
RIG = "virtual-coarse"
RELAXED = 10.0  # x the slowest time: what is left then is e^-10 of its branch
ASSUMED = "assumed: no relaxation of Solaris was found measured"
BOUND = 0.02  # of the headlines, of the steady force


def run(asked: Asked) -> StudyResult:
    """The study. Raises InputError for a bad series, rig or run; SolverError, RunFailed."""
    return _recorded(asked) if asked.runs else _simulated(asked)


# -- simulated -----------------------------------------------------------------------------------


def _simulated(asked: Asked) -> StudyResult:
    protocol, _ = plan.load(PROTOCOL)
    series = series_of(asked.more.get("prony") or (), protocol)
    rig, source = rig_config.load(asked.rig or RIG)
    if not isinstance(rig, VirtualConfig):
        raise InputError(f"{source}: a virtual rig is needed; a real one's runs come by --from")
    depths = _thinned(protocol.depths_mm, asked.scale or 1.0)
    given = {
        "gel": rig.virtual.gel.model_dump(mode="json"),
        "skin": asdict(load_design(protocol.specimen.design).skin),
    }
    jobs, pairs = [], []
    for depth in depths:
        viscous, elastic = _one_depth(protocol, depth, series), _one_depth(protocol, depth, None)
        press = f"{viscous.indenters[0].replace(':', '-')}/p1"
        pairs.append((f"{depth:g} mm, viscous", f"{depth:g} mm, elastic"))
        for name, one, cost in zip(pairs[-1], (viscous, elastic), (25.0, 8.0), strict=True):
            data = one.model_dump(mode="json", exclude={"description"})
            jobs.append(Job(name, follow, {**given, "protocol": data, "press": press}, cost))
    ways, way_jobs = _shipped(given)
    grid = asked.solve([*jobs, *way_jobs])
    found = grid.partial()
    stops = [
        stop for viscous, elastic in pairs if viscous in found and elastic in found
        for stop in simulated(found[viscous], found[elastic], series)
    ]  # fmt: skip
    if not stops:
        grid.require_whole()
    moved_um = max(
        float(1e3 * found[viscous]["moved_mm"].max()) for viscous, _ in pairs if viscous in found
    )
    off_pct = max(_off_closed_form(stop) for stop in stops)
    table = _judged_protocols(ways, found, series)
    notes = [
        f"The camera sees nothing of it: while the force fades at a stop, no point of the face moves "
        f"by more than {moved_um:.1f} um in plane. An image is of the deformation; the force beside "
        "it is a matter of when it was read.",
        f"The closed form (ramp, then hold, of the same way on an elastic gel) is off by at most "
        f"{off_pct:.2g} % of the force at any solved knot.",
        "Shares of the force do not depend on mesh or modulus: a coarser mesh gives the same curve.",
    ]  # fmt: skip
    flags = sorted(
        {name for viscous, _ in pairs for name in found.get(viscous, {}).get("flags", ())}
    )
    settings = {
        "gel": f"Prony series {_words(series)}, {ASSUMED}",
        "rig": f"{source.stem}: {found[pairs[0][0]]['dofs']} unknowns"
        + (f", flagged {', '.join(flags)}" if flags else ""),
        "ramp": f"{protocol.motion.press_feed_mm_min:g} mm/min",
    }
    return _result(
        asked, stops, series, protocol, table, notes, settings,
        simulated_=True, missing=tuple(grid.missing),
        more={"moved_um": moved_um, "closed_form_off_pct": off_pct},
    )  # fmt: skip


def series_of(given: Sequence[str], protocol: Protocol) -> Series:
    """The series as typed, G:TAU_S each, else the protocol's. Raises InputError."""
    pairs: list[tuple[float, float]] = [(g, tau) for g, tau in protocol.specimen.prony if g > 0]
    if given:
        pairs = []
        for text in given:
            g, colon, tau = text.partition(":")
            try:
                pairs.append((float(g), float(tau)))
            except ValueError:
                raise InputError(
                    f"--prony {text}: G:TAU_S is right, as 0.05:3 (5 % of the steady force fade "
                    "with 3 s)"
                ) from None
    if not pairs:
        raise InputError("protocol settling: specimen.prony: a series is needed, or --prony")
    return Series(tuple(g for g, _ in pairs), tuple(tau for _, tau in pairs))


def _one_depth(protocol: Protocol, depth_mm: float, series: Series | None) -> Protocol:
    """The protocol at one depth: on the viscous gel with rests to the end, or elastic with none."""
    rest = 0.0 if series is None else RELAXED * max(series.times_s)
    prony = () if series is None else series.pairs
    fields = {"image"} if series is not None else set()
    return protocol.model_copy(
        update={
            "depths_mm": (depth_mm,),
            "channels": protocol.channels | fields,
            "capture": protocol.capture.model_copy(update={"settle_s": rest}),
            "specimen": protocol.specimen.model_copy(update={"prony": prony}),
        }
    )


def _thinned(depths: Sequence[float], scale: float) -> list[float]:
    """The deepest are kept."""
    return list(depths)[-max(1, round(scale * len(depths))):]  # fmt: skip


def _off_closed_form(stop: Stop) -> float:
    """%: of the stop's force, at most, of the excess itself."""
    off = np.linalg.norm(stop.force_n - stop.steady_n - stop.by_series_n, axis=1)
    return float(100 * off.max() / np.linalg.norm(stop.steady_n))


# -- recorded ------------------------------------------------------------------------------------


def _recorded(asked: Asked) -> StudyResult:
    if asked.more.get("prony"):
        raise InputError("--prony: the series of recorded runs is fitted; leave it out")
    runs = [record.open(folder) for folder in asked.runs]
    found: list[Rest] = []
    for run_ in runs:
        found += rests(run_)
    fitted = fit(found)
    stops = [_stop(rest, fitted, n) for n, rest in enumerate(found)]
    protocol = plan.load(PROTOCOL)[0]
    specimen = runs[0].meta["protocol"]["specimen"]
    ways, jobs = _shipped({
        "gel": rig_config.load(RIG)[0].virtual.gel.model_dump(mode="json"),  # type: ignore[union-attr]
        "skin": asdict(load_design(specimen["design"]).skin),
    })  # fmt: skip
    grid = asked.solve(jobs)
    longest = max(float(rest.wait_s[-1]) for rest in found)
    notes = [
        f"{len(found)} rests of up to {longest:.3g} s; the series leaves {1e3 * fitted.rms_n:.2g} mN "
        "rms of samples averaged over 20 ms.",
    ]  # fmt: skip
    if fitted.unsure:
        slow = ", ".join(f"{tau:.3g} s" for tau in fitted.unsure)
        notes.append(
            f"A branch of {slow} is slower than half of the longest rest: its share, and the steady "
            "force, are extrapolated. Rest longer (settle_s) to know them, and see to the force "
            "sensor's drift, which looks the same."
        )  # fmt: skip
    shares = np.arange(len(found))
    groups = [stop.group for stop in stops]
    total = intervals.estimate(
        shares, groups, lambda rows: sum(fit([found[int(n)] for n in rows]).series.shares),
        "press", "positive",
    )  # fmt: skip
    head = Headline(
        "Share of the steady force that fades", 100 * total.value, "%",
        None if total.low is None else 100 * total.low,
        None if total.high is None else 100 * total.high, total.over,
    )  # fmt: skip
    settings = {
        "runs": ", ".join(str(folder) for folder in asked.runs),
        "gel": f"fitted: {_words(fitted.series)}",
        "ramp": f"{runs[0].meta['protocol']['motion']['press_feed_mm_min']:g} mm/min",
    }
    return _result(
        asked, stops, fitted.series, protocol,
        _judged_protocols(ways, grid.partial(), fitted.series), notes, settings,
        simulated_=all(run_.simulated for run_ in runs), missing=tuple(grid.missing), heads=(head,),
        more={"rms_n": fitted.rms_n, "unsure_tau_s": list(fitted.unsure), "rests": len(found)},
    )  # fmt: skip


def _stop(rest: Rest, fitted: Fitted, n: int) -> Stop:
    return Stop(
        rest.step_id, rest.kind, rest.depth_mm, rest.wait_s, rest.force_n, fitted.steady_n[n],
        fitted.left_n[n], f"{rest.way.press} {rest.depth_mm:g} mm",
    )  # fmt: skip


# -- what both give ------------------------------------------------------------------------------


def _shipped(given: dict[str, Any]) -> tuple[dict[str, float], list[Job]]:
    """Protocols whose stops rest, with their settle_s, and the jobs of their elastic ways.

    Of each the largest ball's first press, on the linear layer: ratios along the way matter here.
    """
    settle, jobs = {}, []
    for name in catalog.names("protocols"):
        protocol, _ = plan.load(name)
        if not protocol.capture.settle_s or name == PROTOCOL or "force" not in protocol.channels:
            continue
        settle[name] = protocol.capture.settle_s
        layer = protocol.model_copy(
            update={
                "indenters": protocol.indenters[-1:],
                "channels": protocol.channels & {"force", "shear"},
                "specimen": protocol.specimen.model_copy(
                    update={"gel_model": "layer", "prony": ()}
                ),
            }
        )
        press = f"{layer.indenters[0].replace(':', '-')}/p1"
        data = layer.model_dump(mode="json", exclude={"description"})
        jobs.append(Job(f"way of {name}", follow, {**given, "protocol": data, "press": press}, 8.0))
    return settle, jobs


def _judged_protocols(
    settle: dict[str, float], found: dict[str, Any], series: Series
) -> dict[str, list[dict[str, float]]]:
    """Rows over settle_s of each protocol, its own settle_s first."""
    tables = {}
    for name, own in settle.items():
        if f"way of {name}" in found:
            tables[name] = judged(found[f"way of {name}"], series, [own, *WAITS_S])
    return tables


def _result(
    asked: Asked, stops: Sequence[Stop], series: Series, protocol: Protocol,
    protocols: dict[str, list[dict[str, float]]], notes: list[str], settings: dict[str, str],
    *, simulated_: bool, missing: tuple[str, ...], more: dict[str, Any],
    heads: tuple[Headline, ...] = (),
) -> StudyResult:  # fmt: skip
    table = _stop_table(stops)
    heads = (*_headlines(table), *heads)
    judged_ = _protocol_table(protocols)
    ramp_s = max(protocol.depths_mm) / (protocol.motion.press_feed_mm_min / 60)
    figures = (
        Drawn(
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
        Drawn(
            "wait-against-gel",
            f"How long to wait for {100 * BOUND:g} % in a gel of one time of relaxation, after a "
            f"ramp of {ramp_s:.2g} s, in closed form: read off your own.",
            partial(draw.sensitivity, ramp_s, BOUND),
            column=True,
        ),
        Drawn(
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
            Table("waits", "Seconds of rest until the force is within a bound of its steady value. "
                  "Empty: the rest was too short to tell.", table),
            Table("protocols", "The shipped protocols with their settle_s, largest ball, on a gel "
                  "of this series. A common factor goes into a calibration's coefficients; scatter "
                  "is left as error.", judged_),
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
             "at_once_pct": float(100 * excess[0] / stop.steady), **_smooth_waits(stop)}
        )  # fmt: skip
    return pd.DataFrame(rows)


def _smooth_waits(stop: Stop) -> dict[str, float]:
    """Of solved knots as they are; of noisy samples by the series that fits them."""
    if len(stop.wait_s) < 200:
        return waits(stop)
    from dataclasses import replace

    return waits(replace(stop, force_n=stop.steady_n + stop.by_series_n))


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
        enough = [row["settle_s"] for row in tried if row["worst_pct"] <= 100 * BOUND]
        rows.append({"protocol": name, **own, f"settle_for_{100 * BOUND:g}pct_s":
                     min(enough, default=float("nan"))})  # fmt: skip
    return pd.DataFrame(rows)


def _verdict(
    heads: Sequence[Headline], protocols: pd.DataFrame, series: Series, asked: Asked
) -> tuple[str, ...]:
    gel = f"the gel fitted to these runs ({_words(series)})" if asked.runs else (
        f"a gel of {_words(series)} ({ASSUMED})"
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
            f"{row['normal_scatter_n']:.2g} N normal and {row['shear_scatter_n']:.2g} N in shear."
        )
    return tuple(lines)


def _words(series: Series) -> str:
    return ", ".join(f"{100 * g:.2g} % in {tau:.2g} s" for g, tau in series.pairs)


def _plain(table: pd.DataFrame) -> list[dict[str, Any]]:
    rows = table.to_dict("records")
    return [{k: None if v != v else v for k, v in row.items()} for row in rows]  # noqa: PLR0124
