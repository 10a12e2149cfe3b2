"""What a study found, in the form that pages, files and docs are made from."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from deltact_fab.common import Check, Status, graded

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from deltact_fab.common import Note


@dataclass(frozen=True)
class ReportFigure:
    """A figure: name is its file's, caption one or two sentences, draw makes it with matplotlib.

    draw takes its figure from `create_figure`, which makes it as wide as the page or the paper
    wants it. column: in a paper one column is enough (3.5 in), else it takes both (7.16 in).
    """

    SERIES_COLOURS: ClassVar = (
        "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#1d2330",
    )  # fmt: skip
    """Okabe and Ito's palette: told apart by people who see colours differently."""
    INK_COLOUR: ClassVar = "#1d2330"
    """Letters and axes."""
    PAPER_COLOUR: ClassVar = "#5b6475"
    """The paper's figures, bounds, and whatever else stands back."""

    name: str
    caption: str
    draw: Callable[[], Figure]
    column: bool = False


@dataclass(frozen=True)
class ReportTable:
    """A table of the page and a CSV file of its name; columns have units in their names.

    shown: the page's columns, None for all; the CSV has all. words: what stands above a column on
    the page in place of its name, for those that need it. A column in which nothing was measured
    is left out of the page.
    """

    name: str
    caption: str
    frame: pd.DataFrame
    columns: tuple[str, ...] | None = None
    words: dict[str, str] = field(default_factory=dict)

    @property
    def records(self) -> list[dict[str, Any]]:
        """Its rows as plain data, None where there is no number."""
        plain = self.frame.astype(object).where(self.frame.notna(), None)
        rows = plain.to_dict("records")
        return [{str(name): value for name, value in row.items()} for row in rows]


GoalState = Literal["met", "missed", "undecided"]


@dataclass(frozen=True)
class Headline:
    """One figure that counts, with its 95 % interval and the paper's own beside it.

    over: what the interval is drawn over ("5 seeds", "9 positions"); low, high None: not known, and
    over says why. goal: the value may be no larger, or with better = "high" no smaller. remark: why
    it disagrees with the paper or misses its goal, or what it depends on. told: it stands in the
    verdict. whole: of all jobs that were asked for.
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

    @property
    def state(self) -> GoalState | None:
        """What is known of the goal: undecided where its interval reaches over it or is not known,
        and of a part of the jobs. None without a goal.
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
    def sentence(self) -> str:
        """It in words, with goal and the paper's value."""
        text = f"{self.what[:1].upper()}{self.what[1:]}: {self.value:.3g} {self.unit}".rstrip()
        if self.low is not None and self.high is not None:
            text += f" [{self.low:.3g} to {self.high:.3g}]"
        if self.goal is not None:
            text += f", the goal of {self.goal:.3g} is {self.state}"
        return text + (f"; the paper {self.paper:g}." if self.paper is not None else ".")

    def as_dict(self) -> dict[str, Any]:
        """Plain data; a value that is no number becomes None."""
        value = self.value if math.isfinite(self.value) else None
        return {**asdict(self), "value": value, "state": self.state}


@dataclass(frozen=True)
class Claim:
    """A sentence that is said only where it is shown: by all jobs, and by every reading with an
    interval that excludes 0.

    text, otherwise: the sentences where every interval lies above 0, and below it. undecided: that
    where it is neither, with what would decide it. readings: ends of the intervals, by their
    names, of the differences that the claim rests on, above 0 where it holds; None: not known.
    """

    text: str
    otherwise: str
    undecided: str
    readings: Mapping[str, tuple[float | None, float | None]]

    def state(self, final: bool = True) -> GoalState:
        """met: it is shown; missed: so is its contrary."""
        ends = self.readings.values()
        if final and ends and all(low is not None and low > 0 for low, _ in ends):
            return "met"
        if final and ends and all(high is not None and high < 0 for _, high in ends):
            return "missed"
        return "undecided"

    def sentence(self, final: bool = True) -> str:
        """What may be said."""
        words = {"met": self.text, "missed": self.otherwise, "undecided": self.undecided}
        return words[self.state(final)]

    def as_dict(self, final: bool = True) -> dict[str, Any]:
        """Plain data."""
        readings = [
            {"name": name, "low": low, "high": high} for name, (low, high) in self.readings.items()
        ]
        return {"says": self.sentence(final), "state": self.state(final), "readings": readings}


@dataclass(frozen=True)
class StudyResult:
    """A study's findings: page, terminal, files and docs are made of it by templates.

    answer: sentences that no figure says, the answer first. more: plain data that only programs
    take. settings: what it was made with, as shown (friction, noise, range, step between frames).
    missing: names of jobs that failed or were not done: with any, nothing is decided.
    files: text of further files beside the page, by name (a recipe). module: what made it.
    """

    GEL_FLAGS: ClassVar = "gel's flags"
    """The setting that says where the simulated gel was beyond what it is made for."""

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
        """Claims, the answer, the figures that are told, what is missing, what the gel flagged."""
        final = not self.missing
        checks = [
            Check(
                f"claim.{k}",
                value=claim.sentence(final),
                status=graded(True, claim.state(final) == "undecided"),
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
        """The findings' sentences."""
        return tuple(str(check.value) for check in self.findings)

    @property
    def data(self) -> dict[str, Any]:
        """All of it as plain data, for `--json`."""
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
