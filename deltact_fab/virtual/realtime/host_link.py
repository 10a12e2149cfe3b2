"""The host's end of the process below the wires: what passes beside them."""

from __future__ import annotations

import pickle
import subprocess
import sys
import threading
from contextlib import suppress
from typing import Any

from ...errors import RunFailed
from .process import Order, Ports

END_S = 10.0
# Not `-m`, by which its classes would be those of `__main__`.
MAIN = "from deltact_fab.virtual.realtime.process import main; main()"


class RemoteBench:
    """The process below the wires, and what its host sends it outside them.

    Raises RunFailed when it cannot be started or has ended, and what it raises itself.
    """

    def __init__(self, order: Order) -> None:
        self._lock = threading.Lock()
        # A session of its own: Ctrl-C is the host's to answer.
        self._process = subprocess.Popen(
            [sys.executable, "-c", MAIN],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        try:
            self.ports: Ports = self._ask(order)
        except BaseException:
            self.close()
            raise

    def ask(self, what: str, **told: object) -> Any:
        """One request; see `process.LiveBench`."""
        return self._ask((what, told))

    def close(self) -> None:
        """End the process; again does nothing."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(BrokenPipeError):
            process.stdin.close()
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()

    def _ask(self, what: object) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            with self._lock:  # a press begins in one thread and ends in another
                pickle.dump(what, self._process.stdin)
                self._process.stdin.flush()
                answer = pickle.load(self._process.stdout)
        except (OSError, EOFError, ValueError, pickle.UnpicklingError) as why:
            raise RunFailed(
                f"the simulated bench has ended (process {self._process.pid}, status "
                f"{self._process.poll()}): its devices are gone"
            ) from why
        if isinstance(answer, BaseException):
            raise answer
        return answer
