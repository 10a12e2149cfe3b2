"""Errors that a user reads: one clear line each, with the exit code the command line gives.

A message names the place (file:key), the value that was found, and what would be right.
"""

from __future__ import annotations

import difflib
import errno
import importlib.util
import re
from collections.abc import Iterable, Sequence

MAX_MESSAGE_CHARACTERS = 300
"""Of a message on the command line."""


class DeltactFabError(Exception):
    """Base of every error that the package raises on purpose. Its text is one line.

    faults: what is wrong, each with its place; untold: how many more there are.
    """

    exit_code = 1

    def __init__(self, *faults: str, untold: int = 0) -> None:
        super().__init__(_joined(faults, untold))
        self.faults = faults
        self.untold = untold


class InputError(DeltactFabError):
    """Input that cannot be used: nothing was run, nothing was written."""

    exit_code = 2


class RunFailed(DeltactFabError):
    """A failure on good input: a check, a solver or a run failed."""

    DISK = (errno.ENOSPC, errno.EDQUOT, errno.EIO)
    """Errors of a full or broken disk: no fault of what was asked."""


class SolverError(RunFailed):
    """A numerical method that missed its stated tolerance, or left its range of validity."""


class TimeLimit(RunFailed):
    """A limit of time that the caller set was reached."""


class Stopped(RunFailed):
    """An end by the operator before it was done, in good order."""

    exit_code = 130


class StageError(RunFailed):
    """A motion controller that refused, alarmed, restarted or fell silent."""


class SensorError(RunFailed):
    """A camera or force sensor that delivered nothing usable."""


class MissingLibrary(DeltactFabError):
    """An absent library of the system or optional package; the text says how to install it."""

    exit_code = 2


def require_extra(extra: str, feature: str, *modules: str) -> None:
    """Require the modules of an extra, none of which is imported; call it before the work.

    what: what cannot be had without them, as it stands before "needs". Raises MissingLibrary.
    """
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise MissingLibrary(f"{feature} needs {module}: pip install 'deltact-fab[{extra}]'")


def did_you_mean(word: str, choices: Iterable[str]) -> str:
    """Return '; did you mean X?' for a near miss, else all valid `choices`."""
    names = sorted(choices)
    near = difflib.get_close_matches(word, names, n=1)
    return f"did you mean {near[0]!r}?" if near else f"valid: {', '.join(names)}"


def fault_line(*faults: str, untold: int = 0) -> str:
    """Join faults to one line of at most MAX_CHARACTERS that any terminal can show.

    What is too long loses first faults from the end, then the inside of its long words.
    """
    plain = [_printable(fault) for fault in faults]
    short = [re.sub(r"\S{61,}", lambda word: f"{word[0][:40]}...{word[0][-16:]}", f) for f in plain]
    for texts in (plain, short):
        for count in range(min(len(texts), MAX_MESSAGE_CHARACTERS // 3), 0, -1):
            line = _joined(texts[:count], len(texts) - count + untold)
            if len(line) <= MAX_MESSAGE_CHARACTERS:
                return line
    tail = _joined(["..."], len(faults) - 1 + untold)
    return short[0][: MAX_MESSAGE_CHARACTERS - len(tail)] + tail


def _printable(text: str) -> str:
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode()
        for c in " ".join(text.split())
    )


def _joined(faults: Sequence[str], untold: int) -> str:
    return " | ".join([*faults, *([f"and {untold} more"] if untold else [])])
