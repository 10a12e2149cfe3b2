"""Errors for users: one line each, with the exit code of the command line.

A message names the location (file: key), the value found and the valid ones.
"""

from __future__ import annotations

import difflib
import errno
import importlib.util
import re
from collections.abc import Iterable, Sequence

MAX_MESSAGE_CHARACTERS = 300
"""Longest message on the command line; by hand: about three lines of a terminal."""


class DeltactFabError(Exception):
    """Base class of the package's errors. The text is one line.

    faults: messages with their locations; untold: number of further ones.
    """

    exit_code = 1

    def __init__(self, *faults: str, untold: int = 0) -> None:
        super().__init__(_joined(faults, untold))
        self.faults = faults
        self.untold = untold


class InputError(DeltactFabError):
    """Invalid input: nothing was run, nothing was written."""

    exit_code = 2


class RunFailed(DeltactFabError):
    """Failure on valid input: of a check, a solver or a run."""

    DISK = (errno.ENOSPC, errno.EDQUOT, errno.EIO)
    """Errors of a full or broken disk, not of the input."""


class SolverError(RunFailed):
    """Numerical method beyond its stated tolerance or range of validity."""


class TimeLimit(RunFailed):
    """Time limit of the caller reached."""


class Stopped(RunFailed):
    """Orderly stop by the operator before the end."""

    exit_code = 130


class StageError(RunFailed):
    """Motion controller that refused, alarmed, restarted or timed out."""


class SensorError(RunFailed):
    """Camera or force sensor without usable data."""


class MissingLibrary(DeltactFabError):
    """Missing system library or optional package; the text gives the install command."""

    exit_code = 2


def require_extra(extra: str, feature: str, *modules: str) -> None:
    """Check that the modules of an extra are installed, without importing them.

    feature: subject of the message, before "needs". Raises MissingLibrary.
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
    """Join faults to one printable line of at most MAX_MESSAGE_CHARACTERS.

    If too long, faults are dropped from the end, then long words are shortened.
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
