"""The operator: who is asked, what counts as a confirmation, and nobody."""

from __future__ import annotations

import sys
from typing import Protocol

from ...errors import RunFailed

TRIES = 5


class Operator(Protocol):
    """Whoever stands at the bench."""

    def tell(self, text: str) -> None:
        """Let them read a line."""

    def ask(self, text: str) -> str:
        """Wait for a line, without blanks at its ends. Raises RunFailed when none can come."""


class TerminalOperator:
    """Asks on standard error and reads lines of standard input."""

    def tell(self, text: str) -> None:
        """A line on standard error, so that standard output stays what the command prints."""
        print(text, file=sys.stderr, flush=True)

    def ask(self, text: str) -> str:
        print(f"{text}: ", end="", file=sys.stderr, flush=True)
        line = sys.stdin.readline()
        if not line:
            raise RunFailed(f"nobody answered ({text}): standard input has ended")
        return line.strip()


def confirm(operator: Operator, name: str, what: str) -> None:
    """Wait until somebody types the name of what they mounted; another name is asked again.

    what: ends "type NAME to confirm that". Raises RunFailed after TRIES other answers.
    """
    for _ in range(TRIES):
        answer = operator.ask(f"type {name} to confirm that {what}")
        if answer == name:
            return
        operator.tell(f"that was {answer!r}, not {name!r}")
    raise RunFailed(f"{name}: not confirmed in {TRIES} answers")
