"""`deltact-fab` as a user calls it: in this process, for a launch of its own is mostly imports.

And how often its functions are called.
"""

from __future__ import annotations

import contextlib
import cProfile
import io
import pstats
import subprocess
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import pytest

from deltact_fab.app.cli.main import PROGRAM_NAME, entry


def called(*words: str | Path, cwd: Path | None = None) -> CompletedProcess[str]:
    """What the console entry prints and ends with; an error that it lets through ends with 1."""
    argv, out, err = [PROGRAM_NAME, *map(str, words)], io.StringIO(), io.StringIO()
    code: object = 0
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.chdir(cwd or Path.cwd()),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        patch.setattr(sys, "argv", argv)
        try:
            entry()
        except SystemExit as end:
            code = end.code
        except Exception:
            traceback.print_exc()
            code = 1
    assert isinstance(code, int)
    return CompletedProcess(argv, code, out.getvalue(), err.getvalue())


@contextlib.contextmanager
def started(*words: str, **how: Any) -> Iterator[subprocess.Popen[str]]:
    """Python with these words in a process of its own, ended with its pipes when the block is.

    A pipe that a failed test leaves open is an error of whatever test runs when it is collected.
    """
    with subprocess.Popen([sys.executable, *words], text=True, **how) as process:
        try:
            yield process
        finally:
            process.kill()


def count_calls(work: Callable[[], Any]) -> tuple[Any, Counter[str]]:
    """What it returns, and this thread's calls by file and function, `flow/tracker.py update`."""
    profile = cProfile.Profile()
    result = profile.runcall(work)
    count: Counter[str] = Counter()
    for (file, _, name), (_, calls, *_) in pstats.Stats(profile).stats.items():
        count[f"{'/'.join(Path(file).parts[-2:])} {name}"] += calls
    return result, count
