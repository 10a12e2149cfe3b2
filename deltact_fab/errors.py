"""Errors that a user reads: one clear line each, with the exit code the command line gives.

A message names the place (file:key), the value that was found, and what would be right.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

MAX_CHARACTERS = 300
"""Of a message on the command line."""
INTERRUPTED = 130
"""Exit code of a command that an operator ended."""


class DeltactFabError(Exception):
    """Base of every error that the package raises on purpose. Its text is one line."""

    exit_code = 1


class InputError(DeltactFabError):
    """What the user gave cannot be used: nothing was run, nothing was written."""

    exit_code = 2


class RunFailed(DeltactFabError):
    """The input was fine, and a check, a solver or a run failed."""


class SolverError(RunFailed):
    """A numerical method did not reach its stated tolerance, or left its range of validity."""


class TimeLimit(RunFailed):
    """A limit of time that the caller set was reached."""


class Stopped(RunFailed):
    """Ended by the operator before it was done, in good order."""

    exit_code = INTERRUPTED


class StageError(RunFailed):
    """The motion controller refused, alarmed, restarted or fell silent."""


class SensorError(RunFailed):
    """A camera or force sensor delivered nothing usable."""


class MissingLibrary(DeltactFabError):
    """A library of the system or an optional package is absent; the text says how to install it."""

    exit_code = 2


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return '; did you mean X?' for a near miss among `known`, else the list of what is valid."""
    names = sorted(known)
    near = difflib.get_close_matches(word, names, n=1)
    return f"did you mean {near[0]!r}?" if near else f"valid: {', '.join(names)}"


def one_line(message: str) -> str:
    """A message as one line of at most MAX_CHARACTERS that any terminal can show.

    What is too long loses first faults from the end, then the inside of its long words.
    """
    line = "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode()
        for c in " ".join(message.split())
    )
    counted = re.search(r" \| and (\d+) more$", line)
    beyond, line = (int(counted[1]), line[: counted.start()]) if counted else (0, line)
    short = re.sub(r"\S{61,}", lambda word: f"{word[0][:40]}...{word[0][-16:]}", line)
    for faults in (line.split(" | "), short.split(" | ")):
        for shown in range(len(faults), 0, -1):
            left = len(faults) - shown + beyond
            more = f" | and {left} more" if left else ""
            line = " | ".join(faults[:shown]) + more
            if len(line) <= MAX_CHARACTERS:
                return line
    return line[: MAX_CHARACTERS - len(more) - 3].removesuffix(more) + "..." + more
