"""`study run settling`: how long to wait at a stop, by the force's error against the wait.

Of recorded runs whose stops rest long (protocol `settling`), on a bench or a virtual rig. The
relaxation that fits them leaves a closed form at each stop.
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
from deltact_fab.estimate import ForceRest, RelaxationFit, find_rests, fit_relaxation
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
WAIT_PERCENTS = (5, 2, 1, 0.5)  # of the steady force: bounds whose waits are given
HEADLINE_PERCENT = 2  # of them, that of the headlines
STOP_AXES = {"press": [2], "shear": [0, 1]}  # the forces that a stop was made for
STOP_WORDS = {"press": "a press", "shear": "a drag"}
RELAXED_TIMES = 10.0  # x the slowest time: what is left then is e^-10 of its branch
MIN_SHOWN_S, MIN_SHOWN_PERCENT = 0.02, 0.05  # shown
SETTLING_MODULUS_NOTE = " Waits for an error in N are those of half or twice as strict a share."
SETTLING_LEFT_OUT = (
    Note("softening by the first press (Mullins)", "the fit has no such memory; press a new gel "
            "as deep before you measure"),
    Note("drift of the force sensor", "looks like a slow branch; see the force after the press"),
    Note("slip while the force fades", "the closed form takes the contact as unchanged: on a "
            "simulated gel at finite strain it was within 1 % of a press's force, and a drag's "
            "excess was up to a fifth larger"),
    Note("images", "while the force fades no point of the face moves by more than a few "
            "micrometres in plane: an image is of the deformation, whenever it was taken"),
)  # fmt: skip


def settling_time_s(wait_s: ArrayLike, error: ArrayLike, bound: float) -> float:
    """The first of wait_s (n,) from which on |error| (n,) is within bound; nan: never.

    Between two of them the error is taken as straight in the logarithm of error and linear in time,
    as it is where it fades.
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
    """A stop: steady_n of the force that it was made for; excess_n (m,) at wait_s (m,) into it.

    measured_n (k,): the same as it was measured, at measured_s (k,).
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
        """steady_n (3,): what the force of this rest fades to."""
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
        """Seconds until the force stays within that of its steady value."""
        return settling_time_s(self.wait_s, self.excess_n, percent * self.steady_n / 100)

    def row(self) -> dict[str, Any]:
        """Of the table."""
        return {
            "stop": self.name, "kind": self.kind, "depth_mm": self.depth_mm,
            "steady_n": self.steady_n, "at_once_n": float(self.excess_n[0]),
            "at_once_percent": float(100 * self.excess_n[0] / self.steady_n),
            **{f"wait_{share:g}_percent_s": self.settle_time_s(share) for share in WAIT_PERCENTS},
        }  # fmt: skip


def run(request: StudyRequest) -> StudyResult:
    """The study. Raises InputError without a run or for one whose stops do not rest; SolverError
    where no series is found.
    """
    if not request.runs:
        raise InputError(
            f"--from: missing; record the protocol {SETTLING_STUDY!r} on a bench or a virtual "
            "rig and name the run"
        )
    runs = [open_run(folder) for folder in request.runs]
    rests = [rest for recording in runs for rest in find_rests(recording)]
    fitted = fit_relaxation(rests)
    ends = zip(rests, fitted.steady_n, strict=True)
    stops = [ForceDecay.from_rest(rest, steady_n, fitted) for rest, steady_n in ends]
    protocol = runs[0].meta["protocol"]
    words = ", ".join(f"{100 * g:.2g} % with {tau:.2g} s" for g, tau in fitted.series.pairs)
    return StudyResult(
        study=SETTLING_STUDY,
        title="How long to wait at a stop",
        simulated=all(source.simulated for source in runs),
        seed=request.seed,
        scale=None,
        answer=("When the tip stops, the force is above its steady value by shares that fade "
                f"exponentially: {words}.",),
        headlines=(
            *_longest_waits(stops),
            Headline("share of the steady force that fades", 100 * sum(fitted.series.shares), "%",
                     None, None, "one series: no interval"),
        ),
        tables=(
            ReportTable("waits", "Rest until the force is within a bound of its steady value.",
                        pd.DataFrame([stop.row() for stop in stops])),
        ),
        figures=(
            ReportFigure(
                "error-against-wait",
                "Force over its steady value against the wait, by depth: in closed form (thick) "
                f"and as measured (thin). Dotted: {', '.join(f'{p:g}' for p in WAIT_PERCENTS)} %.",
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
    """By kind, the wait after which no stop is off by more than BOUND."""
    heads = []
    for kind, words in STOP_WORDS.items():
        waits = [stop.settle_time_s(HEADLINE_PERCENT) for stop in stops if stop.kind == kind]
        if waits:
            label = f"wait after {words} for {HEADLINE_PERCENT} % of the force, the longest"
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
            "steady force, are extrapolated. Rest longer (settle_s) to know them, and see to the "
            "force sensor's drift, which looks the same."
        )
    return notes


def plot_decay(stops: Sequence[ForceDecay]) -> Figure:
    """Error against waiting time, a panel for presses and one for drags, a colour a depth."""
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
