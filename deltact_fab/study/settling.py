"""`study run settling`: how long to wait at a stop, by the force's error against the wait.

Simulated: the protocol `settling` with rests until nothing is left, each depth a job, on the
viscous gel and (for the closed form) on the elastic one. Recorded: the rests of runs, and the
series that fits them. Both give stops, and from there on it is one study.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from .. import catalog, record
from ..analysis.relaxation import Rest, Series, fit, rests
from ..cad.design import load_design
from ..errors import InputError
from ..protocols import plan
from ..protocols.plan import Protocol
from ..report import figures
from ..report.result import Headline, LeftOut, ReportFigure, ReportTable, StudyResult
from . import gel_remarks, intervals
from .grid import GridJob
from .intervals import headline
from .request import share_of, virtual_rig
from .settling_stops import BOUND, PERCENTS, Stop, enough_s, follow, judged, simulated, size

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .request import StudyRequest

STUDY = PROTOCOL = "settling"
CALIBRATION = "force-calibration"
NO_BENCH = (PROTOCOL, "demo", "demo-calibration")  # the first is judged here, of the gel itself
RIG = "virtual-coarse"
BALL = "sphere:"
FADE_S = np.concatenate([[0.0], np.geomspace(0.02, 2000.0, 120)])  # of a fitted series
RELAXED = 10.0  # x the slowest time: what is left then is e^-10 of its branch
MIN_PERCENT = 0.05  # shown


def run(asked: StudyRequest) -> StudyResult:
    """The study. Raises InputError for a bad series, rig or run; SolverError, RunFailed."""
    return _recorded(asked) if asked.runs else _simulated(asked)


# -- simulated -----------------------------------------------------------------------------------


def _simulated(asked: StudyRequest) -> StudyResult:
    protocol, _ = plan.load(PROTOCOL)
    series = series_of(asked.more.get("prony") or (), protocol)
    count = max(1, round(share_of(asked.scale) * len(protocol.depths_mm)))
    given = _gel(asked.rig or RIG, protocol.specimen.design)
    jobs, pairs = [], []
    for depth in protocol.depths_mm[-count:]:  # the deepest are kept
        names = f"{depth:g} mm, viscous", f"{depth:g} mm, elastic"
        for name, of, cost in zip(names, (series, None), (25.0, 8.0), strict=True):
            jobs.append(_job(name, _one_depth(protocol, depth, of), given, cost))
        pairs.append(names)
    ways, way_jobs = shipped(given)
    grid = asked.solve([*jobs, *way_jobs])
    found = grid.partial()
    stops = [
        stop for viscous, elastic in pairs if viscous in found and elastic in found
        for stop in simulated(found[viscous], found[elastic], series)
    ]  # fmt: skip
    if not stops:
        grid.require_whole()
    solved = [found[viscous] for viscous, _ in pairs if viscous in found]
    moved_um = 1e3 * max(one["moved_mm"] for one in solved)
    off_percent = max(
        100 * float(np.abs(s.excess_n - s.series_n).max()) / s.steady_n for s in stops
    )
    flags = sorted({name for one in solved for name in one["flags"]})
    return _result(
        asked, stops, series, _judged(ways, found, series), protocol.specimen.modulus_mpa,
        source="assumed: no relaxation of Solaris was found measured",
        simulated=True,
        more={"moved_um": moved_um, "closed_form_off_percent": off_percent},
        settings={
            "rig": f"{asked.rig or RIG}: {solved[-1]['dofs']} unknowns"
            + (f", flagged {', '.join(flags)}" if flags else ""),
            "ramp": f"{protocol.motion.press_feed_mm_min:g} mm/min",
        },
        notes=(
            "The camera sees nothing of it: while the force fades at a stop, no point of the face "
            f"moves by more than {moved_um:.1f} um in plane. An image is of the deformation; the "
            "force beside it is a matter of when it was read.",
            "The closed form (ramp, then hold, of the same way on an elastic gel) is off by at "
            f"most {off_percent:.2g} % of a press's normal force or a drag's shear, at any solved "
            "knot.",
            "Shares of the force do not depend on the modulus, and hardly on the mesh.",
        ),
    )  # fmt: skip


def series_of(given: Sequence[str], protocol: Protocol) -> Series:
    """The series as typed, G:TAU_S each, else the protocol's. Raises InputError."""
    pairs: list[tuple[float, float]] = [(g, tau) for g, tau in protocol.specimen.prony if g > 0]
    if given:
        pairs = []
        for text in given:
            g, _, tau = text.partition(":")
            try:
                pairs.append((float(g), float(tau)))
            except ValueError:
                raise InputError(
                    f"--prony {text}: expected G:TAU_S, as 0.05:3 (5 % of the steady force fade "
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


def _gel(rig_name: str, design: str) -> dict[str, Any]:
    """Resolution of the simulated gel, and the skin, as a job takes them."""
    gel = virtual_rig(rig_name)[0].virtual.gel
    return {"gel": gel.model_dump(mode="json"), "skin": asdict(load_design(design).skin)}


def _job(name: str, protocol: Protocol, given: dict[str, Any], cost: float) -> GridJob:
    """The first press of a protocol, which has one indenter or takes the first."""
    data = protocol.model_dump(mode="json", exclude={"description"})
    press = f"{protocol.indenters[0].replace(':', '-')}/p1"
    return GridJob(name, follow, {**given, "protocol": data, "press": press}, cost)


# -- recorded ------------------------------------------------------------------------------------


def _recorded(asked: StudyRequest) -> StudyResult:
    if asked.more.get("prony"):
        raise InputError("--prony: the series of recorded runs is fitted; leave it out")
    runs = [record.open(folder) for folder in asked.runs]
    found: list[Rest] = [rest for run_ in runs for rest in rests(run_)]
    fitted = fit(found)
    stops = [
        Stop(
            rest.step_id, rest.kind, rest.depth_mm, f"{rest.way.press} {rest.depth_mm:g} mm",
            float(size(fitted.steady_n[n], rest.kind)), rest.wait_s,
            size(rest.force_n - fitted.steady_n[n], rest.kind),
            size(fitted.left_n(n, rest.wait_s), rest.kind),
            FADE_S, size(fitted.left_n(n, FADE_S), rest.kind),
        )
        for n, rest in enumerate(found)
    ]  # fmt: skip
    protocol = runs[0].meta["protocol"]
    ways, jobs = shipped(_gel(asked.rig or RIG, protocol["specimen"]["design"]))
    grid = asked.solve(jobs)
    longest = max(float(rest.wait_s[-1]) for rest in found)
    notes = [
        f"{len(found)} rests of up to {longest:.3g} s; the series leaves {1e3 * fitted.rms_n:.2g} "
        "mN rms of samples averaged over 20 ms.",
    ]  # fmt: skip
    if fitted.unsure:
        slow = ", ".join(f"{tau:.3g} s" for tau in fitted.unsure)
        notes.append(
            f"A branch of {slow} is slower than half of the longest rest: its share, and the "
            "steady force, are extrapolated. Rest longer (settle_s) to know them, and see to the "
            "force sensor's drift, which looks the same."
        )  # fmt: skip
    total = intervals.estimate(
        np.arange(len(found)), [stop.group for stop in stops],
        lambda rows: sum(fit([found[int(n)] for n in rows]).series.shares), "press", "positive",
    )  # fmt: skip
    return _result(
        asked, stops, fitted.series, _judged(ways, grid.partial(), fitted.series),
        plan.load(PROTOCOL)[0].specimen.modulus_mpa,
        source="fitted to these runs",
        simulated=all(run_.simulated for run_ in runs),
        more={"rms_n": fitted.rms_n, "unsure_tau_s": list(fitted.unsure), "rests": len(found)},
        settings={
            "runs": ", ".join(str(folder) for folder in asked.runs),
            "ramp": f"{protocol['motion']['press_feed_mm_min']:g} mm/min",
        },
        notes=tuple(notes),
        heads=(headline("Share of the steady force that fades", "%", total, 100),),
    )  # fmt: skip


# -- what both give ------------------------------------------------------------------------------


def shipped(given: dict[str, Any]) -> tuple[dict[str, float], list[GridJob]]:
    """Protocols whose stops rest, with their settle_s, and the jobs of their elastic ways.

    Of each that presses a ball the largest one's first press, by the linear gel: ratios along
    the way matter here.
    """
    settle, jobs = {}, []
    for name in catalog.names("protocols"):
        protocol, _ = plan.load(name, by_hand=True)
        balls = [one for one in protocol.indenters if one.startswith(BALL)]
        settle_s, pressed = protocol.capture.wait_s("press"), protocol.depths_mm
        felt = "force" in protocol.channels and name not in NO_BENCH
        if not (settle_s and pressed and felt and balls):
            continue
        largest = max(balls, key=lambda one: float(one.removeprefix(BALL)))
        settle[name] = settle_s
        linear = protocol.model_copy(
            update={
                "indenters": (largest,),
                "channels": protocol.channels & {"force", "shear"},
                "specimen": protocol.specimen.model_copy(
                    update={"gel_model": "linear", "prony": ()}
                ),
            }
        )
        jobs.append(_job(_way(name), linear, given, 8.0))
    return settle, jobs


def _way(protocol: str) -> str:
    return f"way of {protocol}"


def _judged(settle: dict[str, float], found: dict[str, Any], series: Series) -> pd.DataFrame:
    """A row a protocol whose way was solved: its stops' errors, and how long they should rest."""
    enough = f"settle_for_{BOUND}_percent_s"
    return pd.DataFrame(
        {"protocol": name, **judged(found[_way(name)], series, rest),
         enough: enough_s(found[_way(name)], series)}
        for name, rest in settle.items() if _way(name) in found
    )  # fmt: skip


def _result(
    asked: StudyRequest, stops: Sequence[Stop], series: Series, protocols: pd.DataFrame,
    modulus_mpa: float, *, source: str, settings: dict[str, str], notes: tuple[str, ...],
    more: dict[str, Any], heads: tuple[Headline, ...] = (), **made: Any,
) -> StudyResult:  # fmt: skip
    table = pd.DataFrame([stop.row() for stop in stops])
    words = ", ".join(f"{100 * g:.2g} % in {tau:.2g} s" for g, tau in series.pairs)
    return StudyResult(
        study=STUDY,
        title="How long to wait at a stop",
        seed=asked.seed,
        scale=asked.scale,
        answer=(f"Of the gel's steady force fade {words} ({source}).",),
        headlines=(*_waits(table), *_calibration(protocols), *heads),
        tables=(
            ReportTable("waits", "Rest until the force is within a bound of its steady value. "
                        "Empty: the rest was too short to tell.", table),
            ReportTable("protocols", "The shipped protocols with their settle_s. Largest ball, on "
                        "a gel of this series. A common factor goes into a calibration's "
                        "coefficients; scatter is left as error.", protocols),
        ),
        figures=(
            ReportFigure(
                "error-against-wait",
                "Force over its steady value against the wait, by depth: as solved on the viscous "
                "gel (points) or measured (thin), and by the series in closed form (thick). "
                f"Dotted: {', '.join(f'{p:g}' for p in PERCENTS)} %.",
                partial(curve, stops, not asked.runs),
            ),
        ),
        settings={"gel": f"Prony series {words}, {source}", **settings},
        notes=(*notes, "Nothing is drawn at random: the seed does not matter.",
               gel_remarks.remark(STUDY, modulus_mpa)),
        left_out=(
            LeftOut("softening by the first press (Mullins)", "the gel has no such memory; press a "
                    "new gel as deep before you measure"),
            LeftOut("drift of the force sensor", "looks like a slow branch; see the force after "
                    "the press"),
        ),
        more={"prony": [list(pair) for pair in series.pairs], **more},
        **made,
    )  # fmt: skip


def _waits(table: pd.DataFrame) -> list[Headline]:
    heads = []
    column = f"wait_{BOUND}_percent_s"
    for kind, words in (("press", "a press"), ("shear", "a drag")):
        own = table[table["kind"] == kind]
        known = own.dropna(subset=column)
        if len(known):
            found = intervals.mean(known[column], list(known["group"]), "depth", "positive")
            short = len(own) - len(known)
            remark = f"{known[column].min():.3g} to {known[column].max():.3g} s by stop"
            remark += f"; {short} rested too short to tell" if short else ""
            what = f"wait after {words} for {BOUND} % of the force"
            heads.append(headline(what, "s", found, remark=remark, told=True))
    return heads


def _calibration(protocols: pd.DataFrame) -> list[Headline]:
    """What the stops of the calibration of force scatter by, beside the paper's whole RMSE."""
    own = protocols[protocols["protocol"] == CALIBRATION] if len(protocols) else protocols
    return [
        Headline(
            f"scatter of {CALIBRATION}'s {name} force after its rests of {row['settle_s']:g} s",
            row[f"{name}_scatter_n"], "N", None, None, "the stops of one press: no interval",
            remark=f"the paper's whole RMSE: {whole} N; {row[f'{name}_common_percent']:.2g} % are "
            "common to all stops",
            told=name == "normal",
        )
        for _, row in own.iterrows()
        for name, whole in (("normal", "0.3"), ("shear", "0.14 to 0.17"))
    ]  # fmt: skip


def curve(stops: Sequence[Stop], marks: bool) -> Figure:
    """Error against waiting time, a panel for presses and one for drags.

    marks: the stops' own values are points (solved knots), else a line (samples).
    """
    figure, axes = figures.blank(9.6, 3.8, 2)
    own = {"marker": "o", "ms": 3, "ls": ""} if marks else {"lw": 0.6, "alpha": 0.5}
    for axis, kind, words in zip(axes, ("press", "shear"), ("after a press", "after a drag"),
                                 strict=True):  # fmt: skip
        first = {stop.depth_mm: stop for stop in reversed(stops) if stop.kind == kind}
        for colour, (depth, stop) in zip(
            cycle(figures.COLOURS), sorted(first.items()), strict=False
        ):
            later = stop.wait_s > 0
            wait, steady = stop.wait_s[later], stop.steady_n / 100
            axis.plot(wait, stop.excess_n[later] / steady, color=colour, label=f"{depth:g} mm",
                      **own)  # fmt: skip
            axis.plot(wait, stop.series_n[later] / steady, color=colour, lw=1.4)
        for percent in PERCENTS:
            axis.axhline(percent, color=figures.PAPER_COLOUR, lw=0.6, ls=":")
        axis.set(xscale="log", yscale="log", xlabel="wait, s")
        axis.set_title(words, loc="left", fontweight="bold")
    axes[0].set_ylabel("force over its steady value, %")
    axes[0].set_ylim(bottom=max(axes[0].get_ylim()[0], MIN_PERCENT))
    figures.legend_below(figure, axes[0])
    return figure
