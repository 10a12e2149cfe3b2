"""The force sensor and its guard in a process of their own.

An interpreter lock that is shared with encoders costs the guard tens of milliseconds. Here samples
come in and the stop byte goes out of one process that does nothing else; the program asks it for
what was measured. It holds the stage's port open beside the program, for opening it anew would
restart an Arduino. When the program dies, it stops the stage.
"""

from __future__ import annotations

import gc
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from deltact_fab.common import DeltactFabError, InputError, Note, SensorError

from ..interface import Clock, ForceSamples, ForceSensor, Stage, WallClock
from ..tables import ForceConfig, GuardConfig
from .guard import ForceGuard, GuardLimits, Trip
from .netft import SILENT_S, NetFTSensor
from .rdt import RdtLink, fetch

ANSWER_S = 10.0
END_S = 2.0
KEPT = 10_000  # batches that nobody has asked for
SENT = 1000  # samples in an answer, at least: more than one batch only up to so many
REALTIME = 10  # of 1 to 99: over every ordinary thread, under those of the system
NICE = -10


def run_first() -> str:
    """Put this process first, as far as the system lets this user; "" where it does not.

    On Linux, with the right to (`ulimit -r`, `ulimit -e`, or root).
    """
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REALTIME))
        return "real time"
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
        return f"nice {NICE}"
    return ""


def open_force(config: ForceConfig, clock: Clock) -> ForceSensor:
    """The sensor, reached and not streaming yet.

    Raises InputError where the table names no way to it, SensorError where it cannot be reached,
    MissingLibrary.
    """
    if config.netft is not None:
        return NetFTSensor(RdtLink(config.netft, fetch(config.netft)), clock, config.netft.silent_s)
    if config.serial is not None:
        from .scale import SerialScale

        return SerialScale(config, clock)
    raise InputError(
        "force: no way to the sensor; add [force.netft] with its host, or [force.serial] with its "
        "port, to the rig file"
    )


# ---- in the program -----------------------------------------------------------------------------


class Watchdog:
    """Implements rig.interface.ForceSensor, and Guard: what it has to do is done in the process.

    Raises as `open_force`.
    """

    def __init__(self, config: ForceConfig, limits: GuardLimits) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            words = [sys.executable, "-m", __name__, str(theirs.fileno())]
            self._process = subprocess.Popen(
                words,
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is the program's affair
            )
        self._ports = ours  # file descriptors go where messages go
        self._line = Connection(os.dup(ours.fileno()))
        self._lock = threading.RLock()
        self.trip: Trip | None = None
        """Of the guard, as of the last answer."""
        try:
            self._ask("open", config, limits)
        except BaseException:
            self.close()
            raise

    def hold(self, port: int | None, stop: bytes) -> None:
        """Write the stop byte to that descriptor from now on; None: let go of it."""
        with suppress(SensorError):
            self._ask("hold", stop, port is not None, port=port)

    def begin(self, stream: str) -> None:
        self._ask("begin", stream)

    def start(self) -> None:
        self._ask("start")

    def read(self) -> ForceSamples:
        samples: ForceSamples = self._ask("read")
        return samples

    def stop(self) -> None:
        self._ask("stop")

    def identity(self) -> dict[str, Any]:
        """As ForceSensor, and how the system favours the process."""
        about: dict[str, Any] = self._ask("identity")
        return about

    def close(self) -> None:
        """End the process."""
        with suppress(DeltactFabError):
            self._ask("close")
        self._line.close()
        self._ports.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    # ---- the guard ----

    @property
    def tripped(self) -> str:
        return self.trip.why if self.trip is not None else ""

    def watch(self, samples: ForceSamples) -> None:
        """It has seen them."""

    def lost(self, why: str) -> None:
        """It knows."""

    def tell(self) -> tuple[Note, ...]:
        """What it has to say comes with the samples."""
        return ()

    def rearm(self) -> None:
        self._ask("rearm")

    @contextmanager
    def easing(self) -> Iterator[None]:
        """As Guard; a dead one does not leave the tip in the gel."""
        with suppress(SensorError):
            self._ask("ease", True)
        try:
            yield
        finally:
            with suppress(SensorError):
                self._ask("ease", False)

    def _ask(self, what: str, *args: Any, port: int | None = None) -> Any:
        """Its answer. Raises what came of it there, and SensorError where the process is gone."""
        with self._lock:
            try:
                self._line.send((what, args))
                if port is not None:
                    socket.send_fds(self._ports, [b"p"], [port])
                if not self._line.poll(ANSWER_S):
                    self._process.kill()  # a late answer would be taken for the next one's
                    raise SensorError(f"force sensor: no answer within {ANSWER_S:g} s")
                answer, self.trip = self._line.recv()
            except (EOFError, OSError) as why:
                raise SensorError("force sensor: the process that guards the force died") from why
        if isinstance(answer, BaseException):
            raise answer
        return answer


def open_guarded(config: ForceConfig, guard: GuardConfig | None, stage: Stage) -> Watchdog:
    """The sensor of a rig file, and in one with it the guard that stops the stage.

    Raises as `open_force`, and InputError for a limit that the sensor cannot measure.
    """
    force = Watchdog(config, GuardLimits.of(guard, config))
    stage.share(force.hold)
    return force


# ---- in the process -----------------------------------------------------------------------------


class _StopLine:
    """The port of the stage, to write the stop byte to."""

    port: int | None = None
    stop = b""

    def cancel(self) -> None:
        with suppress(OSError):
            if self.port is not None:
                os.write(self.port, self.stop)

    def hold(self, port: int | None, stop: bytes) -> None:
        if self.port is not None:
            os.close(self.port)
        self.port, self.stop = port, stop


class _Server:
    """Reads the sensor, watches, and answers what it is asked."""

    _force: ForceSensor
    _guard: ForceGuard | None = None

    def __init__(self, channel: socket.socket, first: str) -> None:
        """first: how the system favours this process."""
        self._ports, self._first = channel, first
        self._line = Connection(os.dup(channel.fileno()))
        self._clock = WallClock()
        self._stop_line = _StopLine()
        self._easing = ExitStack()
        self._going = False
        self._kept: list[ForceSamples] = []
        self._trouble: SensorError | None = None
        self._asked = False  # for samples, and none were there

    def run(self) -> None:
        """Until the program closes it; whatever else ends it stops the stage."""
        closed = False
        try:
            while not closed:
                if self._going:
                    self._feel()
                if self._asked and (self._kept or self._trouble or not self._going):
                    self._asked = False
                    self._answer(self._samples)
                while self._line.poll(0 if self._going else None):
                    what, args = self._line.recv()
                    if what == "read":
                        self._asked = True
                        break
                    closed = what == "close"
                    self._answer(partial(getattr(self, f"do_{what}"), *args))
                    if closed:
                        break
        except (EOFError, OSError):  # the program is gone
            pass
        finally:
            if not closed:
                self._stop_line.cancel()
            if self._guard is not None:
                self._force.close()

    def do_open(self, config: ForceConfig, limits: GuardLimits) -> None:
        self._force = open_force(config, self._clock)
        silent_s = SILENT_S if config.netft is None else config.netft.silent_s
        self._guard = ForceGuard(self._stop_line.cancel, limits, self._clock, 2 * silent_s)
        gc.freeze()

    def do_hold(self, stop: bytes, follows: bool) -> None:
        port = socket.recv_fds(self._ports, 1, 1)[1][0] if follows else None
        self._stop_line.hold(port, stop)

    def do_begin(self, stream: str) -> None:
        self._force.begin(stream)
        self._kept, self._trouble, self._going = [], None, True

    def do_start(self) -> None:
        self._force.start()
        self._kept, self._trouble, self._going = [], None, True

    def do_stop(self) -> None:
        self._going = False
        self._force.stop()
        self._kept, self._trouble = [], None

    def do_identity(self) -> dict[str, Any]:
        return {**self._force.identity(), "guard": self._first or "as any other process"}

    def do_rearm(self) -> None:
        assert self._guard is not None
        self._guard.rearm()

    def do_ease(self, on: bool) -> None:
        assert self._guard is not None
        self._easing.close()
        if on:
            self._easing.enter_context(self._guard.easing())

    def do_close(self) -> None:
        self._going = False

    def _feel(self) -> None:
        assert self._guard is not None
        try:
            samples = self._force.read()
        except SensorError as why:
            self._guard.lost(str(why))
            self._going, self._trouble = False, why
            return
        self._guard.watch(samples)
        if notes := self._guard.tell():
            samples = replace(samples, notes=samples.notes + notes)
        self._kept.append(samples)
        del self._kept[:-KEPT]

    def _samples(self) -> ForceSamples:
        """What was measured since the last time, or why nothing was."""
        if not self._kept:
            raise self._trouble or SensorError("force sensor: it was not started")
        n, length = 0, 0
        while n < len(self._kept) and (not n or length + len(self._kept[n].t_ns) <= SENT):
            length += len(self._kept[n].t_ns)
            n += 1
        parts, self._kept = self._kept[:n], self._kept[n:]
        return ForceSamples(
            np.concatenate([part.t_ns for part in parts]),
            np.concatenate([part.counts for part in parts]),
            parts[0].per_unit,
            np.concatenate([part.saturated for part in parts]),
            sum(part.lost for part in parts),
            sum(part.late for part in parts),
            tuple(note for part in parts for note in part.notes),
        )

    def _answer(self, what: Any) -> None:
        try:
            answer = what()
        except DeltactFabError as why:
            answer = why
        self._line.send((answer, None if self._guard is None else self._guard.trip))


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with socket.socket(fileno=int(sys.argv[1])) as channel:
        _Server(channel, run_first()).run()
