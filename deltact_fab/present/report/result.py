"""Result of a study, the source of its pages, files and docs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

from deltact_fab.common import Check, Status, graded

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from deltact_fab.common import Note
    from deltact_fab.estimate import Interval


@dataclass(frozen=True)
class ReportFigure:
    """A figure. name: of its file. caption: one or two sentences. draw: plots it by matplotlib.

    draw uses `create_figure`, which sets the width of page or paper. column: in a paper it spans
    one column (3.5 in), else both (7.16 in).
    """

    SERIES_COLOURS: ClassVar = (
        "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#1d2330",
    )  # fmt: skip
    """Palette of Okabe and Ito, distinguishable by colour-blind readers."""
    INK_COLOUR: ClassVar = "#1d2330"
    """Text and axes."""
    PAPER_COLOUR: ClassVar = "#5b6475"
    """The paper's values, bounds and other secondary content."""

    name: str
    caption: str
    draw: Callable[[], Figure]
    column: bool = False


@dataclass(frozen=True)
class ReportTable:
    """Table of the page and CSV file of its name; columns have units in their names.

    The page omits columns without values.
    """

    name: str
    caption: str
    frame: pd.DataFrame

    @property
    def records(self) -> list[dict[str, Any]]:
        """Rows as plain data, None for missing numbers."""
        plain = self.frame.astype(object).where(self.frame.notna(), None)
        rows = plain.to_dict("records")
        return [{str(name): value for name, value in row.items()} for row in rows]


GoalState = Literal["met", "equal", "missed", "undecided"]
"""Equal: of a claim, no difference beyond the margin."""


MISSING_PRICE = "jobs are missing: run the same command"


def decision_price(
    extra: int | None, noun: str, unit_cpu_s: float, gain: str = "would decide"
) -> str:
    """Price of a decision: further units, were the truth as measured, with their CPU time.

    extra: None if UnitDifference.LIMIT units would not decide. noun: of one unit, singular. gain:
    by them.
    """
    if extra is None:
        from deltact_fab.estimate import UnitDifference

        return f"{UnitDifference.LIMIT} {noun}s would not decide"
    cost = f", {unit_cpu_s * extra / 60:.2g} CPU min," if unit_cpu_s else ""
    return f"{extra} {noun}{'s' * (extra > 1)} more{cost} {gain}"


@dataclass(frozen=True)
class Headline:
    """A key figure with its 95 % interval and the paper's value.

    over: groups of the interval ("5 seeds", "9 positions"), or the reason for none (low, high
    None). goal: upper limit of the value, lower with better = "high". remark: reason for differing
    from the paper or missing the goal, or a dependence. told: part of the verdict. whole: no job is
    missing. groups, noun: of the interval; unit_cpu_s: CPU time of one.
    """

    what: str
    value: float
    unit: str
    low: float | None
    high: float | None
    over: str
    paper: float | None = None
    goal: float | None = None
    better: Literal["low", "high"] = "low"
    remark: str = ""
    told: bool = False
    whole: bool = True
    groups: int = 0
    noun: str = "repeat"
    unit_cpu_s: float = 0.0

    @classmethod
    def from_interval(
        cls, label: str, unit: str, interval: Interval, factor: float = 1.0, **fields: Any
    ) -> Self:
        """Figure with its interval. factor: to `unit`, from the interval's own."""
        low, high = (None if end is None else factor * end for end in (interval.low, interval.high))
        fields |= {"groups": interval.groups, "noun": interval.noun}
        return cls(label, factor * interval.value, unit, low, high, interval.over, **fields)

    @property
    def state(self) -> GoalState | None:
        """State of the goal; None without one. Undecided if the interval contains it or is
        unknown, or if jobs are missing.
        """
        if self.goal is None:
            return None
        if not self.whole or self.low is None or self.high is None:
            return "undecided"
        low, high = (self.goal - self.high, self.goal - self.low)
        if self.better == "high":
            low, high = self.low - self.goal, self.high - self.goal
        return "met" if low >= 0 else "missed" if high < 0 else "undecided"

    @property
    def price(self) -> str:
        """Price of deciding an undecided goal; empty for others."""
        if self.state != "undecided":
            return ""
        if not self.whole:
            return MISSING_PRICE
        if self.low is None or self.high is None:
            from deltact_fab.estimate import MIN_GROUPS

            extra = max(MIN_GROUPS - self.groups, 1)
            return decision_price(extra, self.noun, self.unit_cpu_s, "would give an interval")
        return decision_price(self._extra_groups(self.low, self.high), self.noun, self.unit_cpu_s)

    def _extra_groups(self, low: float, high: float) -> int | None:
        """Further groups that would decide, by the interval, of logarithms if all are positive."""
        from scipy.special import stdtrit

        from deltact_fab.estimate import UnitDifference

        assert self.goal is not None
        ends = [self.value, self.goal, low, high]
        if positive := min(ends) > 0:
            ends = [math.log(end) for end in ends]
        value, goal, low, high = ends
        n = max(self.groups, 2)
        error = (high - low) / 2 / float(stdtrit(n - 1, 0.975))
        difference = UnitDifference(value - goal, error, n - 1, (n, n), True, positive)
        needed = difference.units_needed(0.0)
        return None if needed is None else max(needed - self.groups, 1)

    @property
    def sentence(self) -> str:
        """Sentence with the value, goal and the paper's value."""
        text = f"{self.what[:1].upper()}{self.what[1:]}: {self.value:.3g} {self.unit}".rstrip()
        if self.low is not None and self.high is not None:
            text += f" [{self.low:.3g} to {self.high:.3g}]"
        if self.goal is not None:
            text += f", goal {self.goal:.3g}: {self.state}{self.price and f' ({self.price})'}"
        return text + (f"; the paper {self.paper:g}." if self.paper is not None else ".")

    def as_dict(self) -> dict[str, Any]:
        """Return plain data; a non-finite value becomes None."""
        value = self.value if math.isfinite(self.value) else None
        return {**asdict(self), "value": value, "state": self.state, "price": self.price}


@dataclass(frozen=True)
class Claim:
    """A claim, its state, and what would decide an undecided one.

    subject: of an undecided one, after "whether". answers: sentence by the other states. readings:
    interval ends by name of the differences that the claim tests, above 0 if it holds; None:
    unknown. extra: further units that would decide, as of `decision_price`.
    """

    subject: str
    answers: Mapping[GoalState, str]
    state: GoalState
    readings: Mapping[str, tuple[float | None, float | None]]
    extra: int | None = None
    noun: str = "unit"
    unit_cpu_s: float = 0.0

    def sentence(self, final: bool = True) -> str:
        """Sentence of the claim in its state; final: no job is missing."""
        if final and self.state != "undecided":
            return self.answers[self.state]
        gain = "would decide" if self.readings else "would tell the spread"
        price = decision_price(self.extra, self.noun, self.unit_cpu_s, gain)
        return f"Undecided whether {self.subject}: {price if final else MISSING_PRICE}."

    def as_dict(self, final: bool = True) -> dict[str, Any]:
        """Return plain data."""
        readings = [
            {"name": name, "low": low, "high": high} for name, (low, high) in self.readings.items()
        ]
        state = self.state if final else "undecided"
        return {"says": self.sentence(final), "state": state, "readings": readings}


@dataclass(frozen=True)
class StudyResult:
    """A study's findings, the source of page, terminal output, files and docs.

    answer: further sentences of the verdict, the answer first. extra: plain data for programs.
    settings: as shown (friction, noise, range, step between frames). missing: names of jobs without
    a result; with any, nothing is decided. files: text of further files beside the page, by name (a
    recipe). module: the study's module.
    """

    GEL_FLAGS: ClassVar = "gel's flags"
    """Setting that names states outside of the simulated gel's valid range."""

    study: str
    title: str
    simulated: bool
    seed: int
    scale: float | None
    answer: tuple[str, ...] = ()
    claims: tuple[Claim, ...] = ()
    headlines: tuple[Headline, ...] = ()
    tables: tuple[ReportTable, ...] = ()
    figures: tuple[ReportFigure, ...] = ()
    settings: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    left_out: tuple[Note, ...] = ()
    missing: tuple[str, ...] = ()
    files: dict[str, str] = field(default_factory=dict)
    extra: dict[str, Any] = field(default_factory=dict)
    module: str = ""

    @property
    def findings(self) -> tuple[Check, ...]:
        """Checks: claims, answer, key figures, missing jobs, flags of the gel."""
        final = not self.missing
        checks = [
            Check(
                f"claim.{k}",
                value=claim.sentence(final),
                status=graded(True, not final or claim.state == "undecided"),
            )
            for k, claim in enumerate(self.claims)
        ]
        checks += [Check(f"answer.{k}", value=line) for k, line in enumerate(self.answer)]
        checks += [
            Check(f"figure.{k}", value=head.sentence, status=GOAL_STATUS[head.state])
            for k, head in enumerate(self.headlines)
            if head.told
        ]
        goals = Counter(headline.state for headline in self.headlines if headline.state is not None)
        if goals:
            states = [name for name in GOAL_STATES if goals[name]]
            counted = ", ".join(f"{goals[name]} {name}" for name in states)
            checks += [Check("goals", value=f"Goals: {counted}.", status=GOAL_STATUS[states[-1]])]
        if n := len(self.missing):
            are = "job is" if n == 1 else "jobs are"
            checks.append(
                Check("missing", value=f"{n} {are} missing, so nothing is decided.", status="warn")
            )
        if flags := self.settings.get(self.GEL_FLAGS):
            checks.append(
                Check("gel-flags", value=f"The simulated gel is flagged: {flags}.", status="warn")
            )
        return tuple(checks)

    @property
    def verdict(self) -> tuple[str, ...]:
        """Sentences of the findings."""
        return tuple(str(check.value) for check in self.findings)

    @property
    def data(self) -> dict[str, Any]:
        """Result as plain data, for `--json`."""
        return {
            "study": self.study,
            "simulated": self.simulated,
            "seed": self.seed,
            "scale": self.scale,
            "verdict": list(self.verdict),
            "claims": [claim.as_dict(not self.missing) for claim in self.claims],
            "headlines": [head.as_dict() for head in self.headlines],
            "tables": {table.name: table.records for table in self.tables},
            "settings": self.settings,
            "missing": list(self.missing),
            **self.extra,
        }


GOAL_STATES: tuple[GoalState, ...] = ("met", "undecided", "missed")
GOAL_STATUS: dict[GoalState | None, Status] = {
    None: "pass", "met": "pass", "undecided": "warn", "missed": "fail",
}  # fmt: skip
