"""`deltact-fab` as a user calls it, in this process: a launch of its own is mostly imports."""

from __future__ import annotations

import contextlib
import io
import sys
import traceback
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from deltact_fab.cli.main import PROGRAM, entry


def called(*words: str | Path, cwd: Path | None = None) -> CompletedProcess[str]:
    """What the console entry prints and ends with; an error that it lets through ends with 1."""
    argv, out, err = [PROGRAM, *map(str, words)], io.StringIO(), io.StringIO()
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
