"""`study run settling`: waiting time at a stop, from the force's error against the wait.

From recorded runs with long rests (protocol `settling`), on a bench or a virtual rig. The fitted
relaxation gives a closed form at each stop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from deltact_fab.bench import open_run
from deltact_fab.common import Field, InputError, Note
from deltact_fab.estimate import ForceRest, RelaxationFit
from deltact_fab.present import (
    Headline,
    ReportFigure,
    ReportTable,
    StudyResult,
    create_figure,
    draw_legend,
    set_log_scale,
)

from .registry import modulus_remark

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .registry import StudyRequest

SETTLING_STUDY = "settling"
WAIT_PERCENTS = (5, 2, 1, 0.5)  # by hand: bounds of the tables, % of the steady force
HEADLINE_PERCENT = 2  # by hand: the bound of the headlines; smaller waits longer
STOP_AXES = {"press": [2], "shear": [0, 1]}  # definition: force components that a stop changes
STOP_WORDS = {"press": "a press", "shear": "a drag"}
RELAXED_TIMES = 10.0  # by hand: times the slowest relaxation time, which leaves e^-10 of it
MIN_SHOWN_S, MIN_SHOWN_PERCENT = 0.02, 0.05  # by hand: start of the axes; less squeezes the curves
SETTLING_MODULUS_NOTE = " So waits for an error in N are those of half or twice the relative bound."
SETTLING_LEFT_OUT = (
    Note("softening by the first press (Mullins)", "not in the fit; precondition a new gel by a "
            "press as deep"),
    Note("drift of the force sensor", "looks like a slow branch; see the force after the press"),
    Note("slip while the force fades", "the closed form assumes a constant contact: on a simulated "
            "finite-strain gel it was within 1 % of a press's force, and a drag's excess was up "
            "to a fifth larger"),
    Note("images", "during relaxation no point of the face moves by more than a few micrometres "
            "in plane: images do not depend on the wait"),
)  # fmt: skip


def settling_time_s(wait_s: ArrayLike, error: ArrayLike, bound: float) -> float:
    """First time of wait_s (n,) after which |error| (n,) stays within bound; NaN: never.

    Interpolates the logarithm of the error linearly in time, as in a decay.
    """
    wait, magnitude = np.asarray(wait_s, float), np.abs(np.asarray(error, float))
    outside = np.flatnonzero(magnitude > bound)
    if not len(outside):
        return float(wait[0])
    last = int(outside[-1])
    if last + 1 == len(wait):
        return math.nan
    a, b = math.log(magnitude[last]), math.log(max(magnitude[last + 1], bound * 1e-6))
    share = (a - math.log(bound)) / (a - b)
    return float(wait[last] + share * (wait[last + 1] - wait[last]))


class ForceDecay(NamedTuple):
    """Force decay at a stop: steady_n; fitted excess_n (m,) at wait_s (m,).

    measured_n: (k,), measured excess at measured_s (k,).
    """

    name: str
    kind: str
    depth_mm: float
    steady_n: float
    wait_s: Field
    excess_n: Field
    measured_s: Field
    measured_n: Field

    @classmethod
    def from_rest(cls, rest: ForceRest, steady_n: Field, fitted: RelaxationFit) -> ForceDecay:
        """Build from a rest. steady_n: (3,), limit of its force."""
        times_s = fitted.series.times_s
        wait_s = np.geomspace(0.01 * min(times_s), RELAXED_TIMES * max(times_s), 120)
        wait_s = np.concatenate([[0.0], wait_s])

        def size(force_n: Field) -> Field:
            return np.asarray(np.linalg.norm(force_n[..., STOP_AXES[rest.kind]], axis=-1))

        return cls(
            rest.step_id, rest.kind, rest.depth_mm, float(size(steady_n)), wait_s,
            size(fitted.excess(rest, wait_s)), rest.wait_s, size(rest.force_n - steady_n),
        )  # fmt: skip

    def settle_time_s(self, percent: float) -> float:
        """Time until the force stays within a percentage of its steady value, s."""
        return settling_time_s(self.wait_s, self.excess_n, percent * self.steady_n / 100)

    def row(self) -> dict[str, Any]:
        """Row of the table."""
        return {
            "stop": self.name, "kind": self.kind, "depth_mm": self.depth_mm,
            "steady_n": self.steady_n, "at_once_n": float(self.excess_n[0]),
            "at_once_percent": float(100 * self.excess_n[0] / self.steady_n),
            **{f"wait_{share:g}_percent_s": self.settle_time_s(share) for share in WAIT_PERCENTS},
        }  # fmt: skip


def run(request: StudyRequest) -> StudyResult:
    """Run the study. Raises InputError without runs or rests, SolverError if the fit fails."""
    if not request.runs:
        raise InputError(
            f"--from: missing; record the protocol {SETTLING_STUDY!r} on a bench or a virtual "
            "rig and name the run"
        )
    runs = [open_run(folder) for folder in request.runs]
    rests = [rest for recording in runs for rest in ForceRest.find_all(recording)]
    fitted = RelaxationFit.from_rests(rests)
    ends = zip(rests, fitted.steady_n, strict=True)
    stops = [ForceDecay.from_rest(rest, steady_n, fitted) for rest, steady_n in ends]
    protocol = runs[0].meta["protocol"]
    words = ", ".join(f"{100 * g:.2g} % with {tau:.2g} s" for g, tau in fitted.series.pairs)
    return StudyResult(
        study=SETTLING_STUDY,
        title="Waiting time at a stop",
        simulated=all(source.simulated for source in runs),
        seed=request.seed,
        scale=None,
        answer=("After a stop, the force exceeds its steady value by exponentially decaying "
                f"shares: {words}.",),
        headlines=(
            *_longest_waits(stops),
            Headline("decaying share of the steady force", 100 * sum(fitted.series.shares), "%",
                     None, None, "one series: no interval"),
        ),
        tables=(
            ReportTable("waits", "Waits until the force is within a bound of its steady value.",
                        pd.DataFrame([stop.row() for stop in stops])),
        ),
        figures=(
            ReportFigure(
                "error-against-wait",
                "Force over its steady value against the wait, by depth: fitted (thick) and "
                f"measured (thin). Dotted: {', '.join(f'{p:g}' for p in WAIT_PERCENTS)} %.",
                partial(plot_decay, stops),
            ),
        ),
        settings={"runs": ", ".join(map(str, request.runs)),
                  "ramp": f"{protocol['motion']['press_feed_mm_min']:g} mm/min"},
        notes=(*_notes(rests, fitted),
               modulus_remark(protocol["specimen"]["modulus_mpa"], SETTLING_MODULUS_NOTE)),
        left_out=SETTLING_LEFT_OUT,
        extra={"prony": [list(pair) for pair in fitted.series.pairs], "rms_n": fitted.rms_n,
              "unsure_tau_s": list(fitted.unsure)},
    )  # fmt: skip


def _longest_waits(stops: Sequence[ForceDecay]) -> list[Headline]:
    """Headlines: longest wait by kind of stop, for HEADLINE_PERCENT."""
    heads = []
    for kind, words in STOP_WORDS.items():
        waits = [stop.settle_time_s(HEADLINE_PERCENT) for stop in stops if stop.kind == kind]
        if waits:
            label = f"longest wait after {words} for {HEADLINE_PERCENT} % of the force"
            over = f"{len(waits)} stop{'s' * (len(waits) > 1)}: no interval"
            heads.append(Headline(label, max(waits), "s", None, None, over, told=True))
    return heads


def _notes(rests: Sequence[ForceRest], fitted: RelaxationFit) -> list[str]:
    notes = [
        f"{len(rests)} rests of up to {max(float(rest.wait_s[-1]) for rest in rests):.3g} s; the "
        f"series leaves {1e3 * fitted.rms_n:.2g} mN rms of samples averaged over 20 ms."
    ]
    if fitted.unsure:
        slow = ", ".join(f"{tau:.3g} s" for tau in fitted.unsure)
        notes.append(
            f"A branch of {slow} is slower than half of the longest rest: its share, and the "
            "steady force, are extrapolated. Rest longer (settle_s) to measure them, and check "
            "the force sensor's drift, which looks the same."
        )
    return notes


def plot_decay(stops: Sequence[ForceDecay]) -> Figure:
    """Plot error against waiting time: panels for presses and drags, colours for depths."""
    kinds = [kind for kind in STOP_WORDS if any(stop.kind == kind for stop in stops)]
    figure, axes = create_figure(9.6, 3.8, len(kinds))
    depths, series = sorted({s.depth_mm for s in stops}), cycle(ReportFigure.SERIES_COLOURS)
    colours = dict(zip(depths, series, strict=False))
    for axis, kind in zip(axes, kinds, strict=True):
        first = {stop.depth_mm: stop for stop in reversed(stops) if stop.kind == kind}
        for depth, stop in sorted(first.items()):
            for wait_s, excess_n, width, label in (
                (stop.measured_s, stop.measured_n, 0.6, None),
                (stop.wait_s, stop.excess_n, 1.6, f"{depth:g} mm"),
            ):
                later = wait_s > 0
                percent = 100 * excess_n[later] / stop.steady_n
                axis.plot(wait_s[later], percent, lw=width, color=colours[depth], label=label)
        for bound in WAIT_PERCENTS:
            axis.axhline(bound, color=ReportFigure.PAPER_COLOUR, lw=0.6, ls=":")
        set_log_scale(axis, "xy")
        axis.set(xlabel="wait, s", xlim=(MIN_SHOWN_S, None))
        axis.set_title(f"after {STOP_WORDS[kind]}", loc="left", fontweight="bold")
    axes[0].set_ylabel("force over its steady value, %")
    axes[0].set_ylim(bottom=max(axes[0].get_ylim()[0], MIN_SHOWN_PERCENT))
    draw_legend(figure, axes[0])
    return figure
