"""Questions of the pattern selection, each a sequence of comparisons over realisations.

A realisation is a pattern drawn, printed and photographed anew, with a seed that all patterns
share, under the same presses. Its error is the mean over presses; patterns are compared by the
logarithms of paired errors. By n realisations a share 1 - 2 / n of the error rate is spent, so that
any number can follow (Lan and DeMets, Biometrika 70, 1983, 659), and the parts are added
(Bonferroni), so it does not matter how looks depend on each other. A rival is shown to be better at
that level over the number of rivals, as one is enough for "no". "Yes" needs each rival to be shown
worse, "equal" worse or equal, which needs no correction (Berger, Technometrics 24, 1982, 295). A
rival with an outcome is not tracked any more.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd

from deltact_fab.estimate import Interval, UnitDifference
from deltact_fab.fabricate import PatternSeries, SeriesEntry
from deltact_fab.present import Claim, Headline, ReportFigure, ReportTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAPER_BEST = ((0.1, 0.5), (0.075, 0.6))
"""(d in mm, r) of the smallest error in each of the paper's rounds."""
TOO_SMALL_MM, SMALL_D_MM = 0.05, 0.075  # paper: too small to print, and the second round's best
QUESTION_ERROR_RATE = 0.05  # by hand: one wrong answer to a question in twenty
FIRST_LOOK = 3  # by hand: fewer realisations hardly tell their spread
EQUAL_SHARE = 0.1  # by hand: of the error; less changes no choice of a pattern
EQUAL_MM = 0.005
"""Measured, docs/evidence/force.md, "Wrong on purpose": a flow error of 0.14 px (0.005 mm) moves
force by 1 % of its range, one of 0.2 px depth by 0.01 mm."""
Errors = Mapping[str, Mapping[int, float]]
"""Error by pattern and seed of a realisation, mm; infinite where it cannot be tracked."""
RivalOutcome = Literal["worse", "better", "equal", "undecided"]
"""RivalOutcome of a comparison, for the rival."""
Answer = Literal["met", "equal", "missed", "undecided"]
"""State of a claim."""


def press_means(results: Iterable[Mapping[str, Any]], key: str) -> Iterator[tuple[str, int, float]]:
    """Name, seed and mean over presses of a figure of `track_press`; infinite if one has none."""
    parts: dict[tuple[str, int], list[float]] = {}
    for result in results:
        for seed, patterns in result["figures"].items():
            for name, figures in patterns.items():
                value = figures[key]
                parts.setdefault((name, seed), []).append(math.inf if value is None else value)
    for (name, seed), values in parts.items():
        yield name, seed, float(np.mean(values))


def next_look(realisations: int) -> int:
    """Number of realisations at the look that follows."""
    return max(FIRST_LOOK, realisations + max(1, realisations // 2))


@dataclass
class Question:
    """A question whether some patterns have a smaller mean error than each rival.

    subject, answers: as of `Claim`. rivals: patterns by label. outcomes, differences: so far, of
    a rival less the claimed patterns, as logarithms. realisations: at the last look, 2 before any.
    """

    subject: str
    answers: Mapping[Answer, str]
    claimed: tuple[str, ...]
    rivals: Mapping[str, tuple[str, ...]]
    outcomes: dict[str, RivalOutcome] = field(default_factory=dict)
    differences: dict[str, UnitDifference] = field(default_factory=dict)
    margin: float = math.log1p(EQUAL_SHARE)
    realisations: int = 2

    def __post_init__(self) -> None:
        self.outcomes = dict.fromkeys(self.rivals, "undecided")

    def look(self, errors: Errors) -> None:
        """Compare the undecided rivals over the realisations so far."""
        if self.state != "undecided":
            return
        claimed = _mean_errors(errors, self.claimed)
        rates = self._error_rates(len(claimed))
        self.realisations = len(claimed)
        self.margin = math.log1p(max(EQUAL_SHARE, EQUAL_MM / float(np.mean([*claimed.values()]))))
        rivals = {label: _mean_errors(errors, self.rivals[label]) for label in self.undecided}
        best = min([claimed, *rivals.values()], key=lambda side: sum(side.values()))
        for label, rival in rivals.items():
            difference = self.differences[label] = _difference(rival, claimed)
            outcome = self._outcome(difference, *rates)
            # One that is worse than the best so far cannot be the best either.
            if outcome == "undecided" and _difference(rival, best).interval(1 - rates[1])[0] > 0:
                outcome = "worse"
            self.outcomes[label] = outcome

    def _outcome(self, difference: UnitDifference, worse: float, better: float) -> RivalOutcome:
        if difference.is_equal(self.margin, worse):
            return "equal"
        if difference.interval(1 - worse)[0] > 0:
            return "worse"
        return "better" if difference.interval(1 - better)[1] < 0 else "undecided"

    def _error_rates(self, realisations: int) -> tuple[float, float]:
        """Error rates of the next look for a worse (or equal) and for a better rival."""
        rate = QUESTION_ERROR_RATE * (2 / self.realisations - 2 / realisations)
        return rate, rate / len(self.rivals)

    @property
    def undecided(self) -> list[str]:
        """Labels of rivals without an outcome."""
        return [label for label, outcome in self.outcomes.items() if outcome == "undecided"]

    @property
    def state(self) -> Answer:
        """State of the claim: one better rival refutes it."""
        outcomes = set(self.outcomes.values())
        if "better" in outcomes:
            return "missed"
        if "undecided" in outcomes:
            return "undecided"
        return "equal" if "equal" in outcomes else "met"

    @property
    def patterns(self) -> set[str]:
        """Patterns that the next look needs; none if decided."""
        if self.state != "undecided":
            return set()
        return {*self.claimed, *(name for label in self.undecided for name in self.rivals[label])}

    def claim(self, unit_cpu_s: float, realisations: int) -> Claim:
        """Claim with its price. unit_cpu_s: CPU time of a realisation of `patterns`."""
        extra: int | None = FIRST_LOOK - realisations
        if self.differences and self.state == "undecided":
            worse, better = self._error_rates(next_look(self.realisations))
            needed: dict[str, int | None] = {}
            for label in self.undecided:
                difference = self.differences[label]
                rate = worse if difference.value > 0 else better
                needed[label] = difference.units_needed(self.margin, rate)
            # One better rival decides, or else all of them.
            better_labels = [k for k in needed if self.differences[k].value < -self.margin]
            refuting = [n for k in better_labels if (n := needed[k]) is not None]
            numbers = [min(refuting)] if refuting else [*needed.values()]
            finite = [n for n in numbers if n is not None]
            extra = max(next_look(self.realisations), *finite, 0) - realisations
            extra = extra if len(finite) == len(numbers) else None
        answers = {
            state: text.format(
                *(", ".join(label for label, o in self.outcomes.items() if o == outcome)
                  for outcome in ("better", "equal"))
            )
            for state, text in self.answers.items()
        }  # fmt: skip
        readings = {label: _finite(d.interval()) for label, d in self.differences.items()}
        return Claim(self.subject, answers, self.state, readings, extra, "realisation", unit_cpu_s)

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Row per rival: ratio of its error to that of the claimed patterns."""
        return [
            {
                "question": f"whether {self.subject}", "rival": label,
                "ratio": _ratio(d.value), "low": _ratio(low), "high": _ratio(high),
                "realisations": d.counts[0], "outcome": self.outcomes[label],
            }
            for label, d in self.differences.items()
            for low, high in (d.interval(),)
        ]  # fmt: skip


def _mean_errors(errors: Errors, names: Sequence[str]) -> dict[str, float]:
    """Mean error of some patterns by realisation."""
    return {f"{seed}": float(np.mean([errors[name][seed] for name in names]))
            for seed in errors[names[0]]}  # fmt: skip


def _difference(side: Mapping[str, float], base: Mapping[str, float]) -> UnitDifference:
    """Difference of logarithms; infinite if a side cannot be tracked, which no number makes up."""
    if math.isfinite(sum((*side.values(), *base.values()))):
        return UnitDifference.from_units(side, base, relative=True)
    value, n = (math.inf if math.inf in side.values() else -math.inf), len(side)
    return UnitDifference(value, 0.0, n - 1, (n, n), True, True)


def _finite(ends: tuple[float, float]) -> tuple[float | None, float | None]:
    low, high = (end if math.isfinite(end) else None for end in ends)
    return low, high


def _ratio(logarithm: float) -> float | None:
    return math.exp(logarithm) if math.isfinite(logarithm) else None


def paper_questions(entries: Sequence[SeriesEntry]) -> list[Question]:
    """Questions that these patterns can answer: is the paper's best of a round the best, and does
    the error rise at TOO_SMALL_MM. A part of a round answers none.
    """
    questions = []
    for number, ((d_mm, r), grid) in enumerate(
        zip(PAPER_BEST, PatternSeries.grids, strict=True), start=1
    ):
        part = [e for e in entries if number in e.rounds]
        if len(part) < math.prod(map(len, grid)):
            continue
        best = next(e for e in part if (e.recipe.patch_mm, e.recipe.r) == (d_mm, r))
        scope = f"of round {number}"
        questions.append(
            Question(
                f"{best.label} is the best {scope}",
                {
                    "met": f"{best.label} is the best {scope}, as in the paper.",
                    "equal": f"{best.label} is among the best {scope}, equal within "
                    f"{EQUAL_SHARE:.0%} to {{1}}.",
                    "missed": f"Better than the paper's {best.label} {scope}: {{0}}.",
                },
                (best.name,),
                {e.label: (e.name,) for e in part if e != best},
            )
        )
    tiny, small = (tuple(e.name for e in entries if e.recipe.patch_mm == d_mm and 2 in e.rounds)
                   for d_mm in (TOO_SMALL_MM, SMALL_D_MM))  # fmt: skip
    if len(tiny) == len(small) == len(PatternSeries.grids[1][1]):
        label = f"d {TOO_SMALL_MM:g}"
        questions.append(
            Question(
                f"the error rises at {label} mm",
                {
                    "met": f"At {label} mm the error rises, as in the paper.",
                    "equal": f"At {label} mm the error equals that at d {SMALL_D_MM:g} mm within "
                    f"{EQUAL_SHARE:.0%}; the paper's rises.",
                    "missed": f"At {label} mm the error falls; the paper's rises.",
                },
                small,
                {label: tiny},
            )
        )
    return questions


def mean_interval(errors: Errors, name: str, noun: str = "realisation") -> Interval | None:
    """Mean error of a pattern over units; None if it cannot be tracked."""
    values = [*errors.get(name, {}).values()]
    if not values or not math.isfinite(sum(values)):
        return None
    return Interval.mean(values, list(errors[name]), noun, "positive")


def error_headlines(entries: Sequence[SeriesEntry], errors: Errors) -> tuple[Headline, ...]:
    """Errors of the paper's best patterns, with those of the paper."""
    return tuple(
        Headline.from_interval(f"{entry.label}, the published tracker, at the dots", "mm", interval,
                               paper=entry.paper_error_mm)
        for entry in entries
        if entry.paper_error_mm is not None and not entry.paper_about
        if (interval := mean_interval(errors, entry.name)) is not None
    )  # fmt: skip


def error_tables(
    entries: Sequence[SeriesEntry], errors: Errors, questions: Sequence[Question]
) -> tuple[ReportTable, ...]:
    """Tables of patterns and of comparisons."""
    rows = []
    for entry in entries:
        interval = mean_interval(errors, entry.name)
        value, low, high = (None,) * 3 if interval is None else interval[:3]
        rows.append(
            {
                "pattern": entry.label, "round": " and ".join(map(str, entry.rounds)),
                "paper": entry.paper_text.removesuffix(" mm"), "error_mm": value, "low_mm": low,
                "high_mm": high, "realisations": len(errors.get(entry.name, {})),
            }
        )  # fmt: skip
    caption = "Error of each pattern at the dots. Mean over presses, by Eq. 7 of the paper."
    tables = [ReportTable("patterns", caption, pd.DataFrame(rows))]
    if compared := [row for question in questions for row in question.rows]:
        caption = (
            "Comparisons. Ratio of a rival's error to that of the paper's choice, with its 95 % "
            "interval; outcomes are at the levels of repeated looks."
        )
        tables.append(ReportTable("comparisons", caption, pd.DataFrame(compared)))
    return tuple(tables)


def error_chart(entries: Sequence[SeriesEntry], errors: Errors, covers: str) -> ReportFigure:
    """Chart of the errors by round."""
    return ReportFigure(
        "errors",
        "Mean error of the published tracker at the dots, from four realisations with 95 % "
        "intervals over them; "
        f"horizontal lines: the paper's, dashed if given as 'around'. {covers}.",
        partial(_plot_errors, entries, errors),
    )


def _plot_errors(entries: Sequence[SeriesEntry], errors: Errors) -> Figure:
    from deltact_fab.present import create_figure, draw_legend, draw_paper_line

    rounds = [[e for e in entries if number in e.rounds] for number in (1, 2)]
    rounds = [part for part in rounds if part]
    figure, axes = create_figure(7.4, 2.6 * len(rounds) + 0.6, rows=len(rounds), share_y=False)
    for axis, part in zip(axes, rounds, strict=True):
        means = [mean_interval(errors, entry.name) for entry in part]
        highest = max((m.high or m.value for m in means if m), default=0.0)
        words = "the paper"
        for x, (entry, mean) in enumerate(zip(part, means, strict=True)):
            if mean is not None:
                axis.plot(x, mean.value, "o", color=ReportFigure.INK_COLOUR)
                if mean.low is not None and mean.high is not None:
                    axis.plot([x, x], [mean.low, mean.high], color=ReportFigure.INK_COLOUR, lw=0.9)
            if entry.paper_error_mm is not None:
                ends = (x - 0.42, x + 0.42)
                draw_paper_line(axis, entry.paper_error_mm, highest, words, ends, entry.paper_about)
                words = "_"  # the legend names it once
        axis.set_xticks(range(len(part)), [e.label.replace(" r", "\nr") for e in part])
        axis.set_ylabel("mean error, mm")
        axis.set_ylim(bottom=0)
    draw_legend(figure, axes[0])
    return figure
