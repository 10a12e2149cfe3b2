"""A check: one figure held against a limit, and the one way to sum many of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from .errors import InputError

Status = Literal["pass", "not run", "warn", "fail"]
STATUS_ORDER: tuple[Status, ...] = ("pass", "not run", "warn", "fail")
"""From the best to the worst."""


@dataclass(frozen=True)
class Check:
    """One figure held against its limit.

    id: unique in a list of checks and independent of all words. name, subject: what is checked, of
    which part, axis or device. value, limit: numbers, or texts with their units. basis: what the
    value rests on: keys of a design that nobody has measured, steps of a protocol. remedy: what
    to do where it fails. sign: how a value must stand to its limit, where both are numbers.
    margin: distance to the limit, at least 0 where it passes; None where it is no one number.
    """

    id: str
    name: str = ""
    subject: str = ""
    value: float | str = ""
    limit: float | str = ""
    status: Status = "pass"
    basis: tuple[str, ...] = ()
    remedy: str = ""
    sign: Literal["<", "<=", ">=", ""] = ""
    margin: float | None = None

    @classmethod
    def warnings(cls, id: str, lines: Iterable[str]) -> list[Check]:
        """A check that warns for each line."""
        return [cls(f"{id}.{k}", value=line, status="warn") for k, line in enumerate(lines)]

    @classmethod
    def at_most(
        cls, id: str, name: str, subject: str, value: float, limit: float, location: str,
        status: Status,
    ) -> Check:  # fmt: skip
        """The check of a figure that must not exceed its limit, in the unit that subject names."""
        return cls(id, name, subject, value, limit, status, (location,), sign="<=")

    @classmethod
    def refusal(cls, id: str, name: str, reasons: Sequence[str]) -> Check:
        """The check of what is refused in words: it passes where there are none."""
        status, text = graded(not reasons), "; ".join(reasons)
        return cls(id, name, "refusals", len(reasons), 0, status, remedy=text, sign="<=")

    @property
    def reason(self) -> str:
        """Why it fails or warns, in one line; a refusal names its file itself."""
        if self.remedy:
            return self.remedy
        sign = "<" if self.sign == ">=" else ">"
        location = "; ".join(self.basis)
        return f"{self.name}: {self.subject} {self.value:g} {sign} {self.limit:g} at {location}"

    @property
    def failed(self) -> bool:
        """True where it fails; what warns or was not run does not."""
        return self.status == "fail"

    @staticmethod
    def require(checks: Iterable[Check], source: str) -> None:
        """Raise InputError with every failed one; source: the file that they are of."""
        failed = [check for check in checks if check.failed]
        if failed:
            refused = [check.reason for check in failed if check.remedy]
            exceeded = [f"{source}: {check.reason}" for check in failed if not check.remedy]
            raise InputError(*refused, *exceeded)

    def as_dict(self) -> dict[str, Any]:
        """Plain data; a number that is not finite is None."""
        return {
            key: None if isinstance(v, float) and not math.isfinite(v) else v
            for key, v in asdict(self).items()
        }


def graded(passed: bool, warns: bool = False) -> Status:
    """Grade a check that passes or not, and may pass with a warning."""
    return "fail" if not passed else "warn" if warns else "pass"
