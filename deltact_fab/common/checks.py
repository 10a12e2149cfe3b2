"""Checks: values compared with limits, and their summary."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from .errors import InputError

Status = Literal["pass", "not run", "warn", "fail"]
STATUS_ORDER: tuple[Status, ...] = ("pass", "not run", "warn", "fail")
"""Ordered from best to worst."""


@dataclass(frozen=True)
class Check:
    """Comparison of one value with its limit.

    id: unique in a list of checks, independent of texts. name, subject: property checked, and its
    part, axis or device. value, limit: numbers, or texts with units. basis: origin of the value:
    unverified keys of a design, steps of a protocol. remedy: action if it fails. sign: required
    relation of value to limit, if both are numbers. margin: distance to the limit, at least 0 if it
    passes; None if not a single number.
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
        """Create one warning check per line."""
        return [cls(f"{id}.{k}", value=line, status="warn") for k, line in enumerate(lines)]

    @classmethod
    def at_most(
        cls, id: str, name: str, subject: str, value: float, limit: float, location: str,
        status: Status,
    ) -> Check:  # fmt: skip
        """Create a check of value <= limit, in the unit named in subject."""
        return cls(id, name, subject, value, limit, status, (location,), sign="<=")

    @classmethod
    def refusal(cls, id: str, name: str, reasons: Sequence[str]) -> Check:
        """Create a check that fails with the reasons given, and passes without any."""
        status, text = graded(not reasons), "; ".join(reasons)
        return cls(id, name, "refusals", len(reasons), 0, status, remedy=text, sign="<=")

    @property
    def reason(self) -> str:
        """Reason of a failure or warning in one line; a remedy names its file itself."""
        if self.remedy:
            return self.remedy
        sign = "<" if self.sign == ">=" else ">"
        location = "; ".join(self.basis)
        return f"{self.name}: {self.subject} {self.value:g} {sign} {self.limit:g} at {location}"

    @property
    def failed(self) -> bool:
        """True if it fails; False for a warning or a check not run."""
        return self.status == "fail"

    @staticmethod
    def require(checks: Iterable[Check], source: str) -> None:
        """Raise InputError with all failed checks; source: their file."""
        failed = [check for check in checks if check.failed]
        if failed:
            refused = [check.reason for check in failed if check.remedy]
            exceeded = [f"{source}: {check.reason}" for check in failed if not check.remedy]
            raise InputError(*refused, *exceeded)

    def as_dict(self) -> dict[str, Any]:
        """Plain data; non-finite numbers become None."""
        return {
            key: None if isinstance(v, float) and not math.isfinite(v) else v
            for key, v in asdict(self).items()
        }


def graded(passed: bool, warns: bool = False) -> Status:
    """Return the status of a check from its result, optionally a warning."""
    return "fail" if not passed else "warn" if warns else "pass"
