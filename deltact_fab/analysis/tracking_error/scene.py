"""What can be measured on a run, and what is left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ... import record
from ...errors import InputError
from ...measure.flow import named_tracker
from .dots import DOTS

# The one to use, what it is compared with, and what the paper says.
DEFAULT_METHODS = (
    "fused",
    "dis-medium",
    "dis-medium/static",
    "dis-medium/composed-every",
    "dis-fast",
    "paper",
)
ONLY_DOTS = "dot-matrix"  # the law of patterns with nothing between the dots


@dataclass(frozen=True)
class TrackingPlan:
    """Which methods follow a run, whether its dots are followed, and a line a thing left out."""

    methods: tuple[str, ...]
    dots: bool
    left_out: tuple[str, ...]

    @property
    def dense(self) -> tuple[str, ...]:
        """The methods of dense flow among them."""
        return tuple(name for name in self.methods if name != DOTS)


def scene_of(run: record.Run, methods: Sequence[str] | None) -> TrackingPlan:
    """Of a run; methods: None for the default ones.

    Raises InputError for a method that is not known, or of dense flow where there are only dots.
    """
    for name in methods or ():
        named_tracker(name)
    n_dots = len(run.dots_mm())
    if run.pattern["recipe"]["law"] == ONLY_DOTS:
        if methods:
            raise InputError(
                f"{run.folder}: the pattern has only dots (law {ONLY_DOTS!r}) and nothing between "
                f"them that {methods[0]!r} could match; without --method the dots are followed"
            )
        return TrackingPlan((DOTS,), True, ("dense flow: the pattern has only dots to follow",))
    left_out = []
    asked = "dots" in run.meta["protocol"]["channels"]
    if not n_dots:
        left_out.append("error at the dots: the pattern has none")
    elif not asked:
        left_out.append("error at the dots: the channel 'dots' is not asked for")
    if run.truth() is None:
        left_out.append("error against truth: a real rig knows none")
    return TrackingPlan(tuple(methods or DEFAULT_METHODS), bool(n_dots and asked), tuple(left_out))
