"""Calls in fresh processes: one thread on one core, answers that are read line by line.

At its top only the standard library: what a library costs to load is not yet paid in the process,
which is `python -m deltact_fab.numerics.worker CALL`, CALL a function and its arguments as JSON.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from typing import Any

from ..errors import RunFailed
from ..jobs import THREAD_VARIABLES

# A reference takes a minute on a quiet core and several on a busy one; this ends what hangs.
SILENCE_S = 600.0


class WorkerDied(RunFailed):
    """The process ended, or was silent for too long, before it had answered."""


def answers(
    call: Callable[..., Iterator[dict[str, Any]]], *given: Any, silence_s: float = SILENCE_S
) -> Iterator[dict[str, Any]]:
    """What a function of a module yields in a process of its own, as it comes.

    given, and what is yielded, is plain data; the process is ended after silence_s without a line.
    Raises WorkerDied, after what was answered, when the process did not end by itself and well.
    """
    told = json.dumps([call.__module__, call.__name__, *given])
    silent = threading.Event()
    # Errors go to a file, so that a full pipe cannot stop the worker.
    with (
        tempfile.TemporaryFile() as said,
        subprocess.Popen(
            [sys.executable, "-m", __name__, told], stdout=subprocess.PIPE, stderr=said, text=True,
            env={**os.environ, **dict.fromkeys(THREAD_VARIABLES, "1")},
        ) as process,
    ):  # fmt: skip
        assert process.stdout is not None

        def end() -> None:
            silent.set()
            process.kill()

        try:
            while True:
                timer = threading.Timer(silence_s, end)
                timer.start()
                try:
                    line = process.stdout.readline()
                finally:
                    timer.cancel()
                if not line.endswith("\n"):
                    break
                yield json.loads(line)
            code = process.wait()
        finally:
            process.kill()
        if silent.is_set():
            raise WorkerDied(f"no answer for {silence_s:g} s")
        if code:
            said.seek(0)
            words = said.read().decode(errors="replace").strip().splitlines()
            raise WorkerDied(f"exit {code}: {words[-1] if words else 'without a word'}")


def main(module: str, function: str, *given: Any) -> None:
    """Make a call, in its process, which is kept on one core where the system can."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, [max(os.sched_getaffinity(0))])
    # What an engine prints must not stand between the answers.
    with os.fdopen(os.dup(1), "w") as out:
        os.dup2(2, 1)
        for answer in getattr(importlib.import_module(module), function)(*given):
            out.write(json.dumps(answer, allow_nan=False) + "\n")
            out.flush()


if __name__ == "__main__":
    main(*json.loads(sys.argv[1]))
