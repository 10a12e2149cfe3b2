"""Other people's programs, each asked in a process and an environment of its own (`make peers`)."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common.errors import RunFailed
from deltact_fab.common.jobs.local import THREAD_VARIABLES

VARIABLE = "DELTACT_PEERS"
HERE = Path(__file__).resolve().parent
PYTHON = HERE.parent / ".venv-peers" / "bin" / "python"


def python() -> Path | None:
    """The interpreter that DELTACT_PEERS names, else that of the checkout's .venv-peers; None if
    there is none. RunFailed if the variable points nowhere."""
    named = os.environ.get(VARIABLE)
    if named:
        if not Path(named).is_file():
            raise RunFailed(f"{VARIABLE}: {named} is no file; an interpreter with felupe is meant")
        return Path(named).absolute()
    return PYTHON if PYTHON.is_file() else None


def ask(
    name: str, script: str, given: Mapping[str, Any], threads: int = 1, timeout_s: float = 3600.0
) -> dict[str, Any] | None:
    """What `peers/SCRIPT CASE.npz OUT` answers in OUT.npz and OUT.json; None where `python` is.

    name: of the program, for messages. Raises RunFailed when the script breaks or takes longer
    than timeout_s.
    """
    interpreter = python()
    if interpreter is None:
        return None
    environment = {**os.environ, **dict.fromkeys(THREAD_VARIABLES, str(threads))}
    with tempfile.TemporaryDirectory() as scratch:
        case, out = Path(scratch) / "case.npz", Path(scratch) / "answer"
        np.savez(case, **given)
        try:
            ended = subprocess.run(
                [str(interpreter), str(HERE / "peers" / script), str(case), str(out)],
                capture_output=True, text=True, env=environment, timeout=timeout_s, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired as why:
            raise RunFailed(f"{name}: no answer within {timeout_s:g} s") from why
        if ended.returncode:
            words = ended.stderr.strip().splitlines()
            raise RunFailed(
                f"{name}: exit {ended.returncode}: {words[-1] if words else 'without a word'}"
            )
        answer: dict[str, Any] = json.loads(out.with_suffix(".json").read_text(encoding="utf-8"))
        with np.load(out.with_suffix(".npz")) as arrays:
            answer.update({key: arrays[key] for key in arrays.files})
    return answer
