"""Looks at a run between two blocks of presses: fit, validate, decide, and tell.

The loop stands above simulate and estimate: the run hands over the names of its complete presses;
a look reads the unfinished record, never its truth.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deltact_fab.bench import open_run
from deltact_fab.common import InputError, Note, Table, validate

from .goal import RunGoal, count_places, planned_looks
from .rule import MIN_LOOK_PLACES, look_level, upper_rms

if TYPE_CHECKING:
    from deltact_fab.bench import Protocol, Run
    from deltact_fab.simulate import RunRequest

_LOG = logging.getLogger(__name__)
_FURTHER_HINT = "go on with a second protocol, `run PROTOCOL --extends {}`"


class GoalLook(Table):
    """One look, as the journal keeps it.

    presses: complete ones. places: to validate, that were tested. spent: planned places that this
    and earlier looks have levels for. rms, bound: error of the component, and its upper bound at
    the level; None without a decision, for the reason.
    """

    presses: int
    goal: float
    places: int
    spent: int
    level: float
    rms: float | None = None
    bound: float | None = None
    reached: bool = False
    reason: str = ""


class GoalExtension(Table):
    """Extension of a run to a number of presses, as the journal keeps it."""

    extended_to: int


class GoalLooks:
    """Looks at one run; see `EarlyEnd` of the experiment.

    Stored decisions are used again, so that a resumed run makes those of an undisturbed one.
    """

    def __init__(
        self, protocol: Protocol, goal: RunGoal, folder: Path, recorded: Run | None = None,
        extend: int | None = None,
    ) -> None:  # fmt: skip
        """recorded: the run, if it has begun. extend: number of presses more, after its end."""
        self.goal, self.meta, self.extending = goal, goal.as_dict(), extend is not None
        self._presses, self._folder = protocol.list_presses(), folder
        self._due = planned_looks(protocol)
        self.looks: list[GoalLook] = []
        self._end: int | None = None  # of an extension
        for stored in recorded.decisions() if recorded else ():
            source = f"{folder}/journal.sqlite: decision"
            if "extended_to" in stored:
                self._end = validate(GoalExtension, stored, source).extended_to
            else:
                self.looks.append(validate(GoalLook, stored, source))
        self._extension: GoalExtension | None = None  # to be journalled
        if recorded is not None and extend is not None:
            self._end = recorded.count_presses()[0] + extend
            self._extension = GoalExtension(extended_to=self._end)

    @classmethod
    def of_request(
        cls, request: RunRequest, until: str | None, extend: int | None, resume: bool
    ) -> GoalLooks | None:
        """Looks of a run that is requested with a goal, or has one recorded; None without.

        Raises InputError for a goal that its presses cannot show, or a run that cannot be extended.
        """
        recorded = None
        if extend is not None or (resume and request.out.exists()):
            recorded = open_run(request.out)
        goal = None if until is None else RunGoal.from_text(until)
        if goal is None and recorded is not None and "until" in recorded.meta:
            goal = RunGoal.from_record(recorded.meta["until"])
        if recorded is not None and extend is not None:
            _require_extendable(recorded, extend)
        if goal is None:
            return None
        if request.air:
            raise InputError("--until: not with --air, which presses nothing")
        goal.require_shown_by(request.protocol, str(request.source))
        return cls(request.protocol, goal, request.out, recorded, extend)

    def __call__(self, complete: Sequence[str]) -> tuple[bool, str]:
        """Decide if the run ends after these presses; with the text for the journal."""
        n, text = len(complete), ""
        if self._extension is not None:
            text, self._extension = self._extension.model_dump_json(), None
            return False, text
        look = next((look for look in self.looks if look.presses == n), None)
        if look is None and n in (self._due if self._end is None else [self._end]):
            look = self._look(complete)
            self.looks.append(look)
            text = look.model_dump_json()
            _LOG.warning("%s", self.line(look))
        return look is not None and (look.reached if self._end is None else n >= self._end), text

    def _look(self, complete: Sequence[str]) -> GoalLook:
        """Fit to the presses so far, validate and decide."""
        places, planned = count_places(self._presses[: len(complete)]), count_places(self._presses)
        spent = max((look.spent for look in self.looks), default=0)
        level, squares, reason = 0.0, list[float](), ""
        if places == spent:
            reason = "no new place to validate since the last look"
        else:
            from deltact_fab.estimate import validate_partly

            try:
                squares = validate_partly(open_run(self._folder), complete)[self.goal.component]
            except InputError as error:
                reason = str(error)
        rms = bound = None
        if len(squares) >= MIN_LOOK_PLACES:
            level, spent = look_level(places, spent, planned), places
            rms, bound = math.sqrt(sum(squares) / len(squares)), upper_rms(squares, level)
        elif not reason:
            reason = f"{len(squares)} places to validate, {MIN_LOOK_PLACES} needed"
        return GoalLook(
            presses=len(complete), goal=self.goal.limit, places=len(squares), spent=spent,
            level=level, rms=rms, bound=bound,
            reached=bound is not None and bound < self.goal.limit, reason=reason,
        )  # fmt: skip

    def line(self, look: GoalLook) -> str:
        """Format a look in one line."""
        unit, goal = self.goal.unit, f"goal {self.goal.limit:g} {self.goal.unit}"
        text = f"after {look.presses} presses: {self.goal.component} "
        if look.rms is None:
            return f"{text}not tested, {look.reason}; {goal} not shown yet"
        state = "reached" if look.reached else "not shown yet"
        return (
            f"{text}{look.rms:.3g} {unit}, at most {look.bound:.3g} {unit} by {look.places} "
            f"validation places; {goal} {state}"
        )

    def summary(self) -> dict[str, Any]:
        """Goal, result and looks."""
        looks = [look.model_dump(mode="json") for look in self.looks]
        return {**self.meta, "reached": any(look.reached for look in self.looks), "looks": looks}

    def remark(self) -> Note:
        """The result, and what to do where the list has ended without it."""
        if not self.looks:
            return Note("until", f"{self.goal.component}: not looked at")
        look, reached = self.looks[-1], next((e for e in self.looks if e.reached), None)
        text = self.line(look).removesuffix(" yet")
        if reached is not None and not look.reached:
            text += f"; it was reached after {reached.presses} presses"
        elif not look.reached and look.presses == len(self._presses):
            text += f"; its list has ended: {_FURTHER_HINT.format(self._folder)}"
        return Note("until", text)


def _require_extendable(run: Run, extend: int) -> None:
    """Raise InputError unless a run can go on by a number of presses."""
    complete, planned = run.count_presses()
    reason = ""
    if "until" not in run.meta:
        reason = "it has no goal of --until"
    elif not run.finished:
        reason = "it has not finished; continue with --resume"
    elif complete == planned:
        reason = f"all {planned} presses of its list are made; {_FURTHER_HINT.format(run.folder)}"
    elif complete + extend > planned:
        reason = (
            f"its list has {planned - complete} presses more; give --extend {planned - complete}"
        )
    if reason:
        raise InputError(f"{run.folder}: cannot be extended by {extend} presses: {reason}")
