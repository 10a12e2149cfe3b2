"""What a study found, in the form that pages, files and docs are made from."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class ReportFigure:
    """A figure: name is its file's, caption one or two sentences, draw makes it with matplotlib.

    draw takes its figure from `figures.blank`, which makes it as wide as the page or the paper
    wants it. column: in a paper one column is enough (3.5 in), else it takes both (7.16 in).
    """

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
    shown: tuple[str, ...] | None = None
    words: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Headline:
    """One figure that counts, with its 95 % interval and the paper's own beside it.

    over: what the interval is drawn over ("5 seeds", "9 positions"); low, high None: not known, and
    over says why. goal: the value may be no larger, or with better = "high" no smaller. remark: why
    it disagrees with the paper or misses its goal, or what it depends on.
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

    @property
    def met(self) -> bool | None:
        """Whether the goal is met by the value; None without a goal. Not a number meets none."""
        if self.goal is None:
            return None
        return self.value <= self.goal if self.better == "low" else self.value >= self.goal

    @property
    def sure(self) -> bool | None:
        """Whether the whole interval says the same of the goal as the value; None: not known."""
        if self.goal is None or self.low is None or self.high is None:
            return None
        return not self.low < self.goal < self.high

    def as_dict(self) -> dict[str, Any]:
        """Plain data; a value that is no number becomes None."""
        value = self.value if math.isfinite(self.value) else None
        return {**asdict(self), "value": value, "met": self.met}


@dataclass(frozen=True)
class LeftOut:
    """What this scene did without, and what it would have cost where that was measured.

    layer: a name of `numerics.scenes.LAYERS`; what leaving it out saves is added where this
    machine has measured it and cost is empty.
    """

    what: str
    why: str
    cost: str = ""
    layer: str = ""


@dataclass(frozen=True)
class StudyResult:
    """A study's findings. verdict: sentences, the answer first. data: plain data for `--json`.

    settings: what it was made with, as shown (friction, noise, range, step between frames...).
    missing: names of jobs that failed or were not done; statistics over the rest say so.
    files: text of further files beside the page, by name (a recipe).
    """

    study: str
    title: str
    verdict: tuple[str, ...]
    data: dict[str, Any]
    simulated: bool
    seed: int
    scale: float | None
    headlines: tuple[Headline, ...] = ()
    tables: tuple[ReportTable, ...] = ()
    figures: tuple[ReportFigure, ...] = ()
    settings: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    missing: tuple[str, ...] = ()
    files: dict[str, str] = field(default_factory=dict)


def records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a table as plain data, None where there is no number."""
    plain = frame.astype(object).where(frame.notna(), None)
    return [{str(name): value for name, value in row.items()} for row in plain.to_dict("records")]
