"""Starting workers: one fresh process a job, its threads limited, its answers read line by line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from typing import Any

from ..errors import RunFailed
from ..jobs import THREAD_VARIABLES

# A reference takes a minute on a quiet core and several on a busy one; this ends what hangs.
SILENCE_S = 600.0


class WorkerDied(RunFailed):
    """The process ended, or was silent for too long, before it had answered."""


def answers(job: dict[str, Any], silence_s: float = SILENCE_S) -> Iterator[dict[str, Any]]:
    """The answers of a job as they come; the process is ended after silence_s without one.

    Raises WorkerDied, after what was answered, when the process did not end by itself and well.
    """
    environment = dict(os.environ)
    environment.update(dict.fromkeys(THREAD_VARIABLES, str(job["threads"])))
    # Errors go to a file, so that a full pipe cannot stop the worker.
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "deltact_fab.numerics.worker", json.dumps(job)],
            stdout=subprocess.PIPE,
            stderr=said,
            text=True,
            env=environment,
        )
        assert process.stdout is not None
        silent = threading.Event()

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
            process.stdout.close()
            if process.poll() is None:
                process.kill()
                process.wait()
        if silent.is_set():
            raise WorkerDied(f"no answer for {silence_s:g} s")
        if code:
            said.seek(0)
            words = said.read().decode(errors="replace").strip().splitlines()
            raise WorkerDied(f"exit {code}: {words[-1] if words else 'without a word'}")
