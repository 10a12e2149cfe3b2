"""`run --realtime`: the real bench, whose devices are simulated in a process of their own."""

from __future__ import annotations

import pickle
import subprocess
import sys
from typing import Any

from ...errors import RunFailed
from .process import Order, Ports

END_S = 10.0
HOST = "127.0.0.1"
GUARD = 1.0  # of the sensor's range
MODULE = "deltact_fab.virtual.realtime.process"


class Hands:
    """The process below the wires, and what its host tells it beside them.

    Raises RunFailed when it cannot be started or has ended, and what it raises itself.
    """

    def __init__(self, order: Order) -> None:
        # A session of its own: Ctrl-C is the host's to answer.
        self._process = subprocess.Popen(
            [sys.executable, "-m", MODULE],
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
        """One request; see `process.Bench`."""
        return self._ask((what, told))

    def close(self) -> None:
        """End the process; again does nothing."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.close()
        except BrokenPipeError:
            pass
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
