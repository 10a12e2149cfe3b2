"""Inequalities between dimensions, checked before the kernel runs: it fails silently on most.

Each part states its own rules with their numbers, so that an error says what to change.
"""

from __future__ import annotations

from dataclasses import replace

from deltact_fab.common import Check, InputError

from .dimensions import Design
from .registry import design_parts
from .rule import first_of, statement

# Parts that cannot be made smaller come first in an error.
FIRST_PARTS = ("camera", "skin-frame", "acrylic", "screw", "shell")


def rules(design: Design) -> list[Check]:
    """Return every rule of the sensor, the mold and the test bench; its subject is the part."""
    unverified = set(design.unverified())
    parts = design_parts(design)
    parts.sort(key=lambda part: (*FIRST_PARTS, part.name).index(part.name))
    return [
        replace(
            rule,
            id=f"{part.name}.{rule.id}",
            subject=part.name,
            basis=tuple(key for key in rule.basis if key in unverified),
        )
        for part in parts
        for rule in part.rules(design)
    ]


def check_feasible(design: Design, source: str = "") -> None:
    """Raise InputError in one line with the first rules that fail, unless all hold."""
    broken = [f"{r.subject}: {statement(r)} fails" for r in rules(design) if r.failed]
    if broken:
        raise InputError((f"{source}: " if source else "") + first_of(broken, " | "))
