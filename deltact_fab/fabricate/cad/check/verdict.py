"""Verdict of the checks of a design: heads what is written of it and refuses what fails."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from deltact_fab.common import Check, MissingLibrary, Progress, RunFailed

from ..design import reference_designs
from ..dimensions import Design
from ..part import Part
from . import SOLID_CHECKS, check_arithmetic, check_design, check_solids, not_run
from .built import BuiltDesign, Facts

PART_CHECKS = ("soundness", "wall-thickness", "bed-contact")
"""Checks on solids of single parts that need no drawing, of SOLID_CHECKS."""
BUILD_WARNING = "NOT TO BE BUILT"


@dataclass(frozen=True)
class DesignVerdict:
    """Verdict of the checks of a design.

    name: of the design. rows: its checks. is_whole: all checks of `cad check`, not only the rules
    and the exported parts.
    """

    name: str
    rows: tuple[Check, ...]
    is_whole: bool = True

    @property
    def failed(self) -> list[Check]:
        """Failed checks."""
        return [row for row in self.rows if row.failed]

    @property
    def text(self) -> str:
        """Result in one line."""
        passed = [row for row in self.rows if row.status == "pass"]
        unverified = sum(bool(row.basis) for row in passed)
        return (
            f"{len(passed)}/{len(self.rows)} checks passed; "
            f"{unverified} of them depend on unverified values"
        )

    @property
    def failure(self) -> str | None:
        """Number of failed checks in one line; None if none failed."""
        n = len(self.failed)
        return f"{self.name}: {n}/{len(self.rows)} checks failed" if n else None

    @property
    def headline(self) -> str:
        """Result for the head of a page, one line."""
        return f"{BUILD_WARNING}: {self.failure}." if self.failed else f"{self.name}: {self.text}."

    def require(self, force: bool) -> None:
        """Raise RunFailed with the failed checks, unless forced."""
        if self.failed and not force:
            faults = [_line(row) for row in self.failed]
            raise RunFailed(f"{self.failure}; --force writes it, marked {BUILD_WARNING!r}", *faults)

    def findings(self) -> Iterator[Check]:
        """Yield the checks at the head of a page of the design: the result, then each failure."""
        if self.failed:
            yield Check("design", value=self.headline, status="fail")
            for row in self.failed:
                yield Check(row.id, value=_line(row), status="fail")
        else:
            yield Check("design", value=self.headline)
        for row in self.rows:
            if row.status == "not run":
                yield Check(row.id, value=_line(row), status="not run")
        if not self.is_whole:
            text = "Only the rules and these parts were checked: run `cad check` for the whole."
            yield Check("whole", value=text, status="not run")


def _line(row: Check) -> str:
    subject = f"{row.name}, {row.subject}" if row.subject else row.name
    limit = f", limit {row.limit}" if row.limit else ""
    return f"{subject}: {row.value}{limit}" + (f"; {row.remedy}" if row.remedy else "")


def judge_design(
    design: Design,
    name: str,
    progress: Progress | None = None,
    parts: Iterable[Part] | None = None,
    cached: bool = True,
    without_kernel: bool = True,
) -> DesignVerdict:
    """Return the verdict of every check of a design.

    name: of its file, by which a remedy knows what was changed. parts: only the rules and the
    solids of these parts; None: all. progress, cached: as in `check_design`. without_kernel:
    without the CAD kernel the checks on solids are a row that was not run; False: MissingLibrary is
    raised.
    """
    bases = reference_designs(name, design)
    try:
        if parts is None:
            rows = check_design(design, progress, cached=cached, bases=bases)
            return DesignVerdict(name, tuple(rows))
        facts = Facts() if cached else None
        solids = check_solids(
            BuiltDesign(design, tuple(parts), facts=facts, bases=bases), checks=PART_CHECKS
        )
        if facts is not None:
            facts.save()
    except MissingLibrary as error:
        if not without_kernel:
            raise
        solids = [not_run(len(SOLID_CHECKS), str(error))]
    return DesignVerdict(name, (*check_arithmetic(design, bases), *solids), is_whole=parts is None)
