"""The force sensor and its guard in a process of their own.

Sharing the interpreter lock with encoders costs the guard tens of milliseconds. This process only
reads samples and writes the stop byte; the program asks it for the samples. It shares the open
port of the stage, since opening it again would restart an Arduino. If the program dies, it stops
the stage and, if a press was on, lifts the tip until nothing is felt.
"""

from __future__ import annotations

import gc
import math
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from deltact_fab.common import DeltactFabError, InputError, Note, SensorError

from ..interface import (
    CONTACT_N,
    Clock,
    ForceSamples,
    ForceSensor,
    Stage,
    StopCommands,
    WallClock,
    require_past,
)
from ..tables import ForceConfig, GuardConfig
from .guard import ForceGuard, GuardLimits, Trip
from .netft import SENSOR_SILENT_S, NetFTSensor
from .rdt import RdtLink, fetch_settings

# By hand: longer limits report a hung process later, smaller counts lose or delay samples.
GUARD_ANSWER_S = 10.0
GUARD_END_S = 2.0
MAX_BATCHES = 10_000  # kept unread; then the oldest is dropped
MAX_ANSWER_SAMPLES = 1000  # per answer, unless one batch has more
REALTIME_PRIORITY = 10  # SCHED_FIFO, of 1 to 99: over ordinary threads, below the system's
NICE_LEVEL = -10  # decision 0031
# By hand, after the program's death: five lifts leave any gel; a stage rests within the first.
ORPHAN_LIFTS = 5
ORPHAN_REST_S = 10.0
ORPHAN_ANSWER_S = 0.5


def raise_priority() -> str:
    """Raise the priority of this process; return how, "" if not permitted.

    Needs Linux and the right (`ulimit -r`, `ulimit -e`, or root).
    """
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REALTIME_PRIORITY))
        return "real time"
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, NICE_LEVEL)
        return f"nice {NICE_LEVEL}"
    return ""


def open_force(config: ForceConfig, clock: Clock) -> ForceSensor:
    """Connect to the sensor, without starting its stream.

    Raises InputError if the table names no connection, SensorError if it cannot be reached,
    MissingLibrary.
    """
    if config.netft is not None:
        link = RdtLink(config.netft, fetch_settings(config.netft))
        return NetFTSensor(link, clock, config.netft.silent_s)
    if config.serial is not None:
        from .scale import SerialScale

        return SerialScale(config, clock)
    raise InputError(
        "force: no connection given; add [force.netft] with its host, or [force.serial] with its "
        "port, to the rig file"
    )


# ---- in the program -----------------------------------------------------------------------------


class Watchdog:
    """Implements rig.interface.ForceSensor and Guard through the guard process.

    Raises as `open_force`.
    """

    def __init__(
        self, config: ForceConfig, limits: GuardLimits, contact_n: float = CONTACT_N
    ) -> None:
        """contact_n: force above which the tip is lifted if the program dies in a press."""
        parent_end, child_end = socket.socketpair()
        with child_end:
            command = [sys.executable, "-m", __name__, str(child_end.fileno())]
            self._process = subprocess.Popen(
                command,
                pass_fds=[child_end.fileno()],
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is handled by the program
            )
        self._ports = parent_end  # for file descriptors; same socket as the messages
        self._line = Connection(os.dup(parent_end.fileno()))
        self._lock = threading.RLock()
        self.trip: Trip | None = None
        """Trip of the guard at the last answer."""
        try:
            self._request("open", config, limits, contact_n)
        except BaseException:
            self.close()
            raise

    def hold(self, port: int | None, commands: StopCommands) -> None:
        """Stop the stage through that descriptor from now on; None: release it."""
        with suppress(SensorError):
            self._request("hold", commands, port is not None, port=port)

    def begin(self, stream: str) -> None:
        self._request("begin", stream)

    def start(self) -> None:
        self._request("start")

    def read(self) -> ForceSamples:
        samples: ForceSamples = self._request("read")
        return samples

    def stop(self) -> None:
        self._request("stop")

    def identity(self) -> dict[str, Any]:
        """Return the sensor's identity, and the priority of the guard process."""
        about: dict[str, Any] = self._request("identity")
        return about

    def close(self) -> None:
        """End the process."""
        with suppress(DeltactFabError):
            self._request("close")
        self._line.close()
        self._ports.close()
        try:
            self._process.wait(GUARD_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    # ---- the guard ----

    @property
    def tripped(self) -> str:
        return self.trip.reason if self.trip is not None else ""

    def watch(self, samples: ForceSamples) -> None:
        """No-op: the guard process checks every sample."""

    def on_sensor_lost(self, reason: str) -> None:
        """No-op: the guard process detects a lost sensor itself."""

    def pop_notes(self) -> tuple[Note, ...]:
        """Return nothing: notes come with ForceSamples.notes."""
        return ()

    def rearm(self) -> None:
        self._request("rearm")

    @contextmanager
    def easing(self) -> Iterator[None]:
        """Raise the limits for a lift, see Guard; a dead process does not prevent the lift."""
        with suppress(SensorError):
            self._request("ease", True)
        try:
            yield
        finally:
            with suppress(SensorError):
                self._request("ease", False)

    def _request(self, request: str, *args: Any, port: int | None = None) -> Any:
        """Send a request and return the answer. Raises its error, or SensorError if it died."""
        with self._lock:
            try:
                self._line.send((request, args))
                if port is not None:
                    socket.send_fds(self._ports, [b"p"], [port])
                if not self._line.poll(GUARD_ANSWER_S):
                    self._process.kill()  # a late answer would be taken for the next one
                    raise SensorError(f"force sensor: no answer within {GUARD_ANSWER_S:g} s")
                answer, self.trip = self._line.recv()
            except (EOFError, OSError) as error:
                raise SensorError("force sensor: the guard process died") from error
        if isinstance(answer, BaseException):
            raise answer
        return answer


def open_guarded(
    config: ForceConfig, guard: GuardConfig | None, stage: Stage, contact_n: float = CONTACT_N
) -> Watchdog:
    """Open the sensor of a rig file together with the guard that stops the stage.

    contact_n: as for `Watchdog`. Raises as `open_force`, and InputError for a limit that the sensor
    cannot measure.
    """
    force = Watchdog(config, GuardLimits.from_config(guard, config), contact_n)
    stage.share(force.hold)
    return force


# ---- in the process -----------------------------------------------------------------------------


class _StopLine:
    """Descriptor of the stage's port, and the commands that stop it."""

    port: int | None = None
    commands: StopCommands | None = None

    def use(self, port: int | None, commands: StopCommands) -> None:
        if self.port is not None:
            os.close(self.port)
        self.port, self.commands = port, commands

    def send(self, name: str) -> None:
        """Write a command by its name; nothing without a port."""
        with suppress(OSError):
            if self.port is not None:
                os.write(self.port, getattr(self.commands, name))

    def ask(self, name: str, expected: bytes, watch: Callable[[], None], limit_s: float) -> bool:
        """Send a command, until limit_s again; True if the last one is answered as expected.

        False after a reset or an alarm. Only for a port that no program reads any more.
        """
        assert self.commands is not None
        pending = self._received()  # left by the program
        end_s = time.monotonic() + limit_s
        while True:
            self.send(name)
            answer_s, answer = time.monotonic() + ORPHAN_ANSWER_S, b""
            while expected not in answer and time.monotonic() < answer_s:
                watch()
                answer += self._received()
            if any(text in pending + answer for text in self.commands.end_marks):
                return False
            if expected in answer or time.monotonic() > end_s:
                return expected in answer

    def _received(self) -> bytes:
        data = b""
        with suppress(OSError):
            while self.port is not None and select.select([self.port], [], [], 0)[0]:
                if not (part := os.read(self.port, 4096)):
                    break
                data += part
        return data


class _Server:
    """Guard process: reads the sensor, guards, and answers requests."""

    _force: ForceSensor
    _guard: ForceGuard | None = None

    def __init__(self, channel: socket.socket, priority: str) -> None:
        """priority: text of the process's priority."""
        self._ports, self._priority = channel, priority
        self._line = Connection(os.dup(channel.fileno()))
        self._clock = WallClock()
        self._stop_line = _StopLine()
        self._easing = ExitStack()
        self._streaming = self._pressing = self._eased = False  # pressing: from a tare to a stop
        self._batches: list[ForceSamples] = []
        self._error: SensorError | None = None
        self._read_pending = False  # a read waits for samples

    def run(self) -> None:
        """Serve until the program closes it; any other end stops the stage."""
        closed = False
        try:
            while not closed:
                if self._streaming:
                    self._poll_sensor()
                if self._read_pending and (self._batches or self._error or not self._streaming):
                    self._read_pending = False
                    self._answer(self._take_samples)
                while self._line.poll(0 if self._streaming else None):
                    request, args = self._line.recv()
                    if request == "read":
                        self._read_pending = True
                        break
                    closed = request == "close"
                    self._answer(partial(getattr(self, f"do_{request}"), *args))
                    if closed:
                        break
        except (EOFError, OSError):  # the program died
            pass
        finally:
            if not closed:
                self._stop_line.send("cancel")
                if self._pressing and self._guard is not None:
                    self._lift_orphan(self._guard)
            if self._guard is not None:
                self._force.close()

    def _lift_orphan(self, guard: ForceGuard) -> None:
        """Lift the tip of a program that died in a press, while it is felt; tell the outcome."""
        line, risen_mm, force_n = self._stop_line, 0.0, 0.0
        if (commands := line.commands) is None:
            return

        def watch() -> None:
            nonlocal force_n
            if self._streaming:
                self._poll_sensor()
            newest_n = self._batches[-1].force_n.mean(axis=0) if self._batches else 0.0
            force_n = math.inf if self._error else float(np.linalg.norm(newest_n))

        with guard.easing():
            watch()
            while line.ask("query", commands.idle, watch, ORPHAN_REST_S):
                if risen_mm >= ORPHAN_LIFTS * commands.lift_mm:
                    break
                contact = self._contact_n < force_n < math.inf
                if not (contact and line.ask("lift", commands.accepted, watch, 0.0)):
                    break
                risen_mm += commands.lift_mm
        if risen_mm or force_n > self._contact_n:
            force = "no force reading" if force_n == math.inf else f"force {force_n:.2f} N"
            outcome = f"lifted by {risen_mm:.0f} mm" if risen_mm else "NOT lifted"
            text = f"the program died in a press: the tip was {outcome}, {force}"
            print(f"deltact-fab guard: {text}", file=sys.stderr, flush=True)

    def do_open(self, config: ForceConfig, limits: GuardLimits, contact_n: float) -> None:
        self._force, self._contact_n = open_force(config, self._clock), contact_n
        silent_s = SENSOR_SILENT_S if config.netft is None else config.netft.silent_s
        cancel, hold = (partial(self._stop_line.send, name) for name in ("cancel", "hold"))
        self._guard = ForceGuard(cancel, limits, self._clock, 2 * silent_s, hold)
        gc.freeze()

    def do_hold(self, commands: StopCommands, follows: bool) -> None:
        port = socket.recv_fds(self._ports, 1, 1)[1][0] if follows else None
        self._stop_line.use(port, commands)

    def do_begin(self, stream: str) -> None:
        self._force.begin(stream)
        self._batches, self._error, self._streaming, self._pressing = [], None, True, True

    def do_start(self) -> None:
        self._force.start()
        self._batches, self._error, self._streaming = [], None, True

    def do_stop(self) -> None:
        self._streaming = False
        self._pressing = self._pressing and self._eased  # a lift ends the press
        self._force.stop()
        self._batches, self._error = [], None

    def do_identity(self) -> dict[str, Any]:
        return {**self._force.identity(), "guard": self._priority or "normal priority"}

    def do_rearm(self) -> None:
        assert self._guard is not None
        self._guard.rearm()

    def do_ease(self, on: bool) -> None:
        assert self._guard is not None
        self._easing.close()
        self._eased = on
        if on:
            self._easing.enter_context(self._guard.easing())

    def do_close(self) -> None:
        self._streaming = False

    def _poll_sensor(self) -> None:
        assert self._guard is not None
        try:
            samples = self._force.read()
            require_past("force sensor", samples.t_ns[-1] / 1e9, self._clock.now_s())
        except SensorError as error:
            self._guard.on_sensor_lost(str(error))
            self._streaming, self._error = False, error
            return
        self._guard.watch(samples)
        if notes := self._guard.pop_notes():
            samples = replace(samples, notes=samples.notes + notes)
        self._batches.append(samples)
        del self._batches[:-MAX_BATCHES]

    def _take_samples(self) -> ForceSamples:
        """Return queued samples; raise the sensor's error if there are none."""
        if not self._batches:
            raise self._error or SensorError("force sensor: not started")
        n, length = 0, 0
        waiting = self._batches
        while n < len(waiting) and (not n or length + len(waiting[n].t_ns) <= MAX_ANSWER_SAMPLES):
            length += len(waiting[n].t_ns)
            n += 1
        parts, self._batches = waiting[:n], waiting[n:]
        return ForceSamples(
            np.concatenate([part.t_ns for part in parts]),
            np.concatenate([part.counts for part in parts]),
            parts[0].per_unit,
            np.concatenate([part.saturated for part in parts]),
            sum(part.n_lost for part in parts),
            sum(part.n_late for part in parts),
            tuple(note for part in parts for note in part.notes),
        )

    def _answer(self, operation: Any) -> None:
        try:
            answer = operation()
        except DeltactFabError as error:
            answer = error
        self._line.send((answer, None if self._guard is None else self._guard.trip))


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with socket.socket(fileno=int(sys.argv[1])) as channel:
        _Server(channel, raise_priority()).run()
