"""What a study found, in the form that pages, files and docs are made from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Drawn:
    """A figure: name is its file's, caption one or two sentences, draw makes it with matplotlib."""

    name: str
    caption: str
    draw: Callable[[], Figure]


@dataclass(frozen=True)
class Table:
    """A table of the page and a CSV file of its name; columns have units in their names.

    shown: the page's columns, None for all; the CSV has all.
    """

    name: str
    caption: str
    frame: pd.DataFrame
    shown: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Headline:
    """One figure that counts, with its 95 % interval and the paper's own beside it.

    over: what the interval is drawn over ("5 seeds", "9 positions"); low, high None: not known, and
    over says why. remark: why it disagrees, or what it depends on.
    """

    what: str
    value: float
    unit: str
    low: float | None
    high: float | None
    over: str
    paper: float | None = None
    goal: float | None = None
    remark: str = ""


@dataclass(frozen=True)
class LeftOut:
    """What this scene did without, and what it would have cost where that was measured."""

    what: str
    why: str
    cost: str = ""


@dataclass(frozen=True)
class StudyResult:
    """A study's findings. verdict: sentences, the answer first. data: plain data for `--json`.

    settings: what it was made with, as shown (friction, noise, range, step between frames...).
    missing: names of jobs that failed or were not done; statistics over the rest say so.
    files: name -> text, written beside the page and linked from it, such as a recipe to print.
    """

    study: str
    title: str
    verdict: tuple[str, ...]
    data: dict[str, Any]
    simulated: bool
    seed: int
    scale: float | None
    headlines: tuple[Headline, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Drawn, ...] = ()
    settings: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    missing: tuple[str, ...] = ()
    files: dict[str, str] = field(default_factory=dict)
