"""What a page says first: its findings, each once; the worst of them is its colour."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

Level = Literal["good", "warning", "bad"]
LEVELS: tuple[Level, ...] = ("good", "warning", "bad")


class Finding(NamedTuple):
    """A sentence and how bad it is."""

    text: str
    level: Level = "good"


class Verdict(NamedTuple):
    """level: the worst of the findings'."""

    findings: tuple[Finding, ...]
    level: Level


def verdict(findings: Iterable[Finding]) -> Verdict:
    """Of all that a page has to say for and against what it shows."""
    once = tuple(dict.fromkeys(findings))
    return Verdict(once, max((one.level for one in once), key=LEVELS.index, default="good"))


def warnings(lines: Iterable[str]) -> list[Finding]:
    """A finding for each line that is a warning."""
    return [Finding(line, "warning") for line in lines]
