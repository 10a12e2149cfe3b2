"""What a lab says of its drawings: the fields of ISO 7200 that no program can know."""

from __future__ import annotations

import datetime
from dataclasses import dataclass, field, fields
from typing import Any

from ...pdf import width_em
from ...shapes.bounded import Bounded, ShapeError

LONGEST = 60


def words(meaning: str) -> Any:
    """A line of the title block, empty until somebody gives it."""
    return field(default="", metadata={"description": meaning})


@dataclass(frozen=True)
class TitleBlock(Bounded):
    """The title block's fields that come from the lab, never from a clock: equal bytes stay equal.

    An empty one is drawn as a dash.
    """

    number: str = words("drawing number; a part's is this, a hyphen and its name")
    revision: str = words("revision, as in A or 02")
    date: str = words("date of issue, as in 2026-11-23")
    owner: str = words("legal owner: the lab")
    drawn_by: str = words("who made it")
    approved_by: str = words("who approved it")

    def __post_init__(self) -> None:
        for f in fields(self):
            said = getattr(self, f.name)
            if len(said) > LONGEST or not said.isprintable():
                raise ShapeError(
                    f"{f.name}: one line of at most {LONGEST} characters: {said!r} fails"
                )
            try:
                width_em(said)
            except ValueError as why:
                raise ShapeError(f"{f.name}: {why}; expected Latin letters") from why
        if self.date:
            try:
                datetime.date.fromisoformat(self.date)
            except ValueError as why:
                raise ShapeError(f"date: expected one as 2026-11-23: {self.date!r} fails") from why

    def number_of(self, part: str) -> str:
        """The drawing number of a part; empty without a number of the lab's."""
        return f"{self.number}-{part}" if self.number else ""
