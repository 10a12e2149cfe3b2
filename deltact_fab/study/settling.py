"""`study run settling`: how long to wait at a stop, by the force's error against the wait.

The gel's relaxation is assumed, typed, or fitted to recorded rests. What it leaves at the stops of
`settling` and of the other shipped protocols follows in closed form from their ways on the linear
elastic gel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import cache, partial
from itertools import cycle
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from .. import catalog, record
from ..aliases import Field
from ..analysis.relaxation import Series, fit, rests, time_to
from ..cad.design import load_design
from ..errors import InputError
from ..levels import LINEAR
from ..protocols import plan
from ..protocols.plan import Protocol
from ..report import figures
from ..report.result import Headline, LeftOut, ReportFigure, ReportTable, StudyResult
from . import gel_remarks, intervals
from .grid import GridJob
from .intervals import Interval, headline
from .settling_stops import BOUND, PERCENTS, enough_s, follow, judged, left, size

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .request import StudyRequest

STUDY = PROTOCOL = "settling"
CALIBRATION = "force-calibration"
NOT_JUDGED = ("demo", "demo-calibration")  # their gel does not relax
BALL = "sphere:"
WAY_S = 10.0
"""A way's cost on one core."""
RELAXED = 10.0  # x the slowest time: what is left then is e^-10 of its branch
MIN_PERCENT = 0.05  # shown
LEFT_OUT = (
    LeftOut("softening by the first press (Mullins)", "the gel has no such memory; press a new gel "
            "as deep before you measure"),
    LeftOut("drift of the force sensor", "looks like a slow branch; see the force after the press"),
    LeftOut("large strain and slip while the force fades", "on the relaxing gel at finite strain a "
            "press's force is within 1 % of the closed form; a drag's own excess is up to a fifth "
            "larger"),
    LeftOut("images", "while the force fades no point of the face moves by more than some "
            "micrometres in plane: an image is of the deformation, whenever it was taken"),
)  # fmt: skip


class Fading(NamedTuple):
    """A stop: steady_n of the force that it was made for; excess_n (m,) at wait_s (m,) into it."""

    name: str
    kind: str
    depth_mm: float
    steady_n: float
    wait_s: Field
    excess_n: Field

    def wait(self, percent: float) -> float:
        """Seconds until the force stays within that of its steady value."""
        return time_to(self.wait_s, self.excess_n, percent * self.steady_n / 100)

    def row(self) -> dict[str, Any]:
        """Of the table."""
        return {
            "stop": self.name, "kind": self.kind, "depth_mm": self.depth_mm,
            "steady_n": self.steady_n, "at_once_n": float(self.excess_n[0]),
            "at_once_percent": float(100 * self.excess_n[0] / self.steady_n),
            **{f"wait_{percent:g}_percent_s": self.wait(percent) for percent in PERCENTS},
        }  # fmt: skip


def run(asked: StudyRequest) -> StudyResult:
    """The study. Raises InputError for a bad series or run; SolverError, RunFailed."""
    typed = asked.more.get("prony") or ()
    if asked.runs:
        if typed:
            raise InputError("--prony: the series of recorded runs is fitted; leave it out")
        return _recorded(asked)
    protocol, _ = plan.load(PROTOCOL)
    source = "typed" if typed else "assumed: no relaxation of Solaris was found measured"
    series = series_of(typed, protocol)

    def over(of: Callable[[Series], float]) -> Interval:
        return Interval(of(series), None, None, "one series: no interval")

    return _result(asked, protocol, series, source, over)


def series_of(typed: Sequence[str], protocol: Protocol) -> Series:
    """The series as typed, G:TAU_S each, else the protocol's. Raises InputError."""
    pairs = protocol.specimen.prony
    try:
        if typed:
            pairs = tuple((float(g), float(tau)) for g, tau in (one.split(":") for one in typed))
    except ValueError:
        raise InputError(
            f"--prony {' '.join(typed)}: expected G:TAU_S, as 0.05:3 (5 % of the steady force fade "
            "with 3 s)"
        ) from None
    return Series(tuple(g for g, _ in pairs), tuple(tau for _, tau in pairs))


def _recorded(asked: StudyRequest) -> StudyResult:
    """With the series that fits the rests of recorded runs, whose protocol is the first one's."""
    runs = [record.open(folder) for folder in asked.runs]
    found = [rest for run_ in runs for rest in rests(run_)]
    fitted = fit(found)
    presses = [f"{rest.way.press} {rest.depth_mm:g} mm" for rest in found]
    refit = cache(lambda rows: fit([found[int(n)] for n in rows]).series)

    def over(of: Callable[[Series], float]) -> Interval:
        return intervals.estimate(
            np.arange(len(found)), presses, lambda rows: of(refit(tuple(rows))), "press", "positive"
        )

    notes = [
        f"{len(found)} rests of up to {max(float(rest.wait_s[-1]) for rest in found):.3g} s; the "
        f"series leaves {1e3 * fitted.rms_n:.2g} mN rms of samples averaged over 20 ms.",
    ]
    if fitted.unsure:
        slow = ", ".join(f"{tau:.3g} s" for tau in fitted.unsure)
        notes.append(
            f"A branch of {slow} is slower than half of the longest rest: its share, and the "
            "steady force, are extrapolated. Rest longer (settle_s) to know them, and see to the "
            "force sensor's drift, which looks the same."
        )
    source = f"{asked.runs[0]}/run.json: protocol"
    result = _result(
        asked, catalog.validate(Protocol, runs[0].meta["protocol"], source), fitted.series,
        "fitted to these runs", over,
        [
            Fading(rest.step_id, rest.kind, rest.depth_mm, float(size(steady_n, rest.kind)),
                   rest.wait_s, size(rest.force_n - steady_n, rest.kind))
            for rest, steady_n in zip(found, fitted.steady_n, strict=True)
        ],
    )  # fmt: skip
    return replace(
        result,
        simulated=all(run_.simulated for run_ in runs),
        headlines=(
            *result.headlines,
            headline("share of the steady force that fades", "%", over(lambda s: sum(s.shares)),
                     100),
        ),
        settings={"runs": ", ".join(map(str, asked.runs)), **result.settings},
        notes=(*notes, *result.notes),
        more={**result.more, "rms_n": fitted.rms_n, "unsure_tau_s": list(fitted.unsure)},
    )  # fmt: skip


def _result(
    asked: StudyRequest, protocol: Protocol, series: Series, source: str,
    over: Callable[[Callable[[Series], float]], Interval], measured: Sequence[Fading] = (),
) -> StudyResult:  # fmt: skip
    """What a series leaves at the stops of a protocol, and of those shipped.

    over: a figure of the series with its interval.
    """
    own = f"{PROTOCOL}, as recorded" if asked.runs else PROTOCOL
    protocols = shipped() | {own: protocol}
    grid = asked.solve([job_of(name, one) for name, one in protocols.items()])
    stops, ways = fading(grid[own], series), grid.partial()
    waits = pd.DataFrame([stop.row() for stop in stops])
    errors = pd.DataFrame(
        {"protocol": name, **judged(ways[name], series, one.capture.wait_s("press") or 0.0),
         f"settle_for_{BOUND}_percent_s": enough_s(ways[name], series)}
        for name, one in protocols.items() if name in ways
    )  # fmt: skip
    words = ", ".join(f"{100 * g:.2g} % with {tau:.2g} s" for g, tau in series.pairs)
    return StudyResult(
        study=STUDY,
        title="How long to wait at a stop",
        simulated=True,
        seed=asked.seed,
        scale=None,
        answer=("When the tip stops, the force is above its steady value by shares that fade "
                f"exponentially: {words} ({source}).",),
        headlines=(
            *(headline(f"wait after {words} for {BOUND} % of the force, the longest", "s",
                       over(partial(longest_s, grid[own], kind)), told=True)
              for kind, words in (("press", "a press"), ("shear", "a drag"))
              if any(stop.kind == kind for stop in stops)),
            *_calibration(errors),
        ),
        tables=(
            ReportTable("waits", "Rest until the force is within a bound of its steady value.",
                        waits),
            ReportTable("protocols", "Protocols with their settle_s. Largest ball, on a gel that "
                        "fades so. A common factor goes into a calibration's coefficients; scatter "
                        "is left as error.", errors),
        ),
        figures=(
            ReportFigure(
                "error-against-wait",
                "Force over its steady value against the wait, by depth: in closed form (thick) "
                f"and as measured (thin). Dotted: {', '.join(f'{p:g}' for p in PERCENTS)} %.",
                partial(curve, stops, measured),
            ),
        ),
        settings={"gel": f"{words}, {source}; elastic part linear",
                  "ramp": f"{protocol.motion.press_feed_mm_min:g} mm/min"},
        notes=(gel_remarks.remark(STUDY, protocol.specimen.modulus_mpa),),
        left_out=LEFT_OUT,
        more={"prony": [list(pair) for pair in series.pairs]},
    )  # fmt: skip


def shipped() -> dict[str, Protocol]:
    """The protocols whose stops rest while the force on a ball is felt."""
    found = {name: plan.load(name, by_hand=True)[0] for name in catalog.names("protocols")}
    return {
        name: one for name, one in found.items()
        if one.capture.wait_s("press") and one.depths_mm and "force" in one.channels
        and any(of.startswith(BALL) for of in one.indenters) and name not in NOT_JUDGED
    }  # fmt: skip


def job_of(name: str, protocol: Protocol) -> GridJob:
    """The way of a protocol's largest ball, of another indenter where it has none.

    By the linear gel: ratios along the way matter here.
    """
    largest = max(
        protocol.indenters, key=lambda of: float(of.removeprefix(BALL)) if BALL in of else 0.0
    )
    skin = asdict(load_design(protocol.specimen.design).skin)
    elastic = {"gel_model": LINEAR, "prony": ()}
    one = protocol.model_copy(
        update={
            "indenters": (largest,),
            "channels": protocol.channels & {"force", "shear"},
            "specimen": protocol.specimen.model_copy(update=elastic),
        }
    )
    told = one.model_dump(mode="json", exclude={"description"})
    return GridJob(name, follow, {"protocol": told, "skin": skin}, WAY_S)


def fading(way: dict[str, Any], series: Series) -> list[Fading]:
    """The stops of a way, each of which rests until nothing is left."""
    ends_s = 0.01 * min(series.times_s), RELAXED * max(series.times_s)
    wait_s = np.concatenate([[0.0], np.geomspace(*ends_s, 120)])
    return [
        Fading(stop["id"], stop["kind"], stop["depth_mm"], float(size(steady_n, stop["kind"])),
               wait_s, size(excess_n, stop["kind"]))
        for stop, steady_n, excess_n in zip(way["stops"], *left(way, series, wait_s), strict=True)
    ]  # fmt: skip


def longest_s(way: dict[str, Any], kind: str, series: Series) -> float:
    """The wait after which no stop of a kind is off by more than BOUND."""
    return max(stop.wait(BOUND) for stop in fading(way, series) if stop.kind == kind)


def _calibration(protocols: pd.DataFrame) -> list[Headline]:
    """What the stops of the calibration of force scatter by, beside the paper's whole RMSE."""
    return [
        Headline(
            f"scatter of {CALIBRATION}'s {name} force after its rests of {row['settle_s']:g} s",
            row[f"{name}_scatter_n"], "N", None, None, "the stops of one press: no interval",
            remark=f"the paper's whole RMSE: {whole} N; {row[f'{name}_common_percent']:.2g} % are "
            "common to all stops",
            told=name == "normal",
        )
        for _, row in protocols[protocols["protocol"] == CALIBRATION].iterrows()
        for name, whole in (("normal", "0.3"), ("shear", "0.14 to 0.17"))
    ]  # fmt: skip


def curve(stops: Sequence[Fading], measured: Sequence[Fading]) -> Figure:
    """Error against waiting time, a panel for presses and one for drags, a colour a depth."""
    figure, axes = figures.blank(9.6, 3.8, 2)
    depths = sorted({stop.depth_mm for stop in (*stops, *measured)})
    colours = dict(zip(depths, cycle(figures.COLOURS), strict=False))
    for axis, kind, words in zip(axes, ("press", "shear"), ("after a press", "after a drag"),
                                 strict=True):  # fmt: skip
        for shown, width in ((measured, 0.6), (stops, 1.6)):
            first = {stop.depth_mm: stop for stop in reversed(shown) if stop.kind == kind}
            for depth, stop in sorted(first.items()):
                later = stop.wait_s > 0
                percent = 100 * stop.excess_n[later] / stop.steady_n
                label = f"{depth:g} mm" if shown is stops else None
                axis.plot(stop.wait_s[later], percent, lw=width, color=colours[depth], label=label)
        for bound in PERCENTS:
            axis.axhline(bound, color=figures.PAPER_COLOUR, lw=0.6, ls=":")
        axis.set(xscale="log", yscale="log", xlabel="wait, s")
        axis.set_title(words, loc="left", fontweight="bold")
    axes[0].set_ylabel("force over its steady value, %")
    axes[0].set_ylim(bottom=max(axes[0].get_ylim()[0], MIN_PERCENT))
    figures.legend_below(figure, axes[0])
    return figure
