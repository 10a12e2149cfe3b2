"""Monitors of a bench's surroundings: temperature, humidity, light, as lines of one number each.

A program writes them to its standard output, or a device to a serial port; a thread of the run
reads them. A reading beyond its limits pauses the run, and so does an unknown one: of a source that
ended, is silent or wrote what is no reading. A source that ended is opened again.
"""

from __future__ import annotations

import re
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import DeltactFabError, SensorError, to_ns

from ..record.streams import MONITOR_PREFIX, Chunk
from .force.lines import FIRST_LINES, LineReader, open_port
from .program import ChildProgram
from .tables import MonitorConfig

# By hand: longer times delay the end of a run or a source's return, shorter ones load the host.
MONITOR_READ_S = 0.1
REOPEN_SOURCE_S = 2.0
NOTE_AGAIN_S = 10.0  # by hand: a value at its limit would flood the journal
OUTPUT_BYTES, MAX_PARTIAL_BYTES = 4096, 1024  # by hand: of one read, many lines; of a line


class Monitor:
    """One `[[monitor]]`: a thread calls `step`, the run takes its readings."""

    def __init__(self, table: MonitorConfig, folder: Path) -> None:
        """folder: of the rig file."""
        self.table, self._folder = table, folder
        self._device: ChildProgram | Any = None  # Any: pyserial has no types
        self._value: float | None = None
        self._fault = ""  # of the last line or of the source
        self._timed = self._in_trouble = False
        self._due_ns = self._kept_ns = self._noted_ns = self._reopen_ns = 0
        self._readings: deque[tuple[int, float]] = deque()
        self._buffer = np.empty(OUTPUT_BYTES, np.uint8)

    def start(self, timed: bool, note: Callable[[str], None]) -> None:
        """Open the source. Raises InputError for a faulty table, SensorError if it is required.

        timed: readings are kept with their times; else `mark` keeps one. note: called by `step`
        when a problem begins.
        """
        self._timed, self._note = timed, note
        # A device repeats its words before it is understood.
        self._due_ns = time.monotonic_ns() + to_ns(FIRST_LINES * self.table.silent_s)
        try:
            self._open()
        except SensorError as error:
            if self.table.required:
                raise
            self._lose(error)

    def step(self) -> None:
        """Read what has come, waiting up to MONITOR_READ_S; open a lost source again."""
        try:
            self._receive()
        except (DeltactFabError, OSError, TypeError) as error:  # TypeError: pyserial, once closed
            self._lose(error)
        problem, now_ns = self.problem(), time.monotonic_ns()
        if problem and not self._in_trouble and now_ns >= self._noted_ns + to_ns(NOTE_AGAIN_S):
            self._noted_ns = now_ns
            self._note(problem)
        self._in_trouble = bool(problem)

    def close(self) -> None:
        """End the program or close the port; idempotent."""
        device, self._device = self._device, None
        if device is not None:
            with suppress(OSError):
                device.close()

    @property
    def awaited(self) -> bool:
        """True until the first reading or its time limit."""
        return self._value is None and not self.problem()

    @property
    def text(self) -> str:
        """Newest reading with its name and unit."""
        return f"{self.table.name} = {self._value:g} {self.table.unit}".rstrip()

    def problem(self) -> str:
        """Reason why its value is unknown or beyond its limits, "" for none."""
        return self._unknown() or self._outside()

    def pause_reason(self) -> str:
        """Problem that pauses the run, "" for none."""
        unknown = self._unknown()
        return unknown * self.table.required if unknown else self._outside()

    def mark(self, t_ns: int) -> None:
        """Keep the newest reading under this time, unless all are kept or it is unknown."""
        if not self._timed and self._value is not None and not self._unknown():
            self._readings.append((t_ns, self._value))

    def take(self, origin_ns: int) -> list[Chunk]:
        """Return readings since the last call, times relative to origin_ns."""
        rows = [self._readings.popleft() for _ in range(len(self._readings))]
        if not rows:
            return []
        t_ns, values = zip(*rows, strict=True)
        columns = {"t_ns": np.array(t_ns, np.int64) - origin_ns, "value": np.array(values, float)}
        return [Chunk(f"{MONITOR_PREFIX}{self.table.name}", origin_ns / 1e9, columns)]

    def _unknown(self) -> str:
        fault = self._fault
        if not fault and time.monotonic_ns() > self._due_ns:
            refused = self._lines.refused
            hint = f": the last line was {refused}" if refused else ""
            fault = f"no reading within {self.table.silent_s:g} s{hint}"
        return f"{self.table.name}: {fault}" if fault else ""

    def _outside(self) -> str:
        low, high, value = self.table.min, self.table.max, self._value
        if value is not None and low is not None and value < low:
            return f"{self.text}, below min = {low:g}"
        if value is not None and high is not None and value > high:
            return f"{self.text}, above max = {high:g}"
        return ""

    def _open(self) -> None:
        table, key = self.table, f"monitor.{self.table.name}"
        # A program writes a number alone; a device may write words, the same in every line.
        self._lines = LineReader(None, None if table.command is None else b"\0")
        self._partial = b""
        if table.command is None:
            place = str(table.port), table.baud
            self._device = open_port("monitor", f"{key}.port", *place, MONITOR_READ_S)
        else:
            name = table.command[0]
            self._device = ChildProgram(name, f"{key}.command", table.command, self._folder)

    def _receive(self) -> None:
        device = self._device
        if device is None:
            time.sleep(MONITOR_READ_S)
            if time.monotonic_ns() >= self._reopen_ns:
                self._open()
            return
        if isinstance(device, ChildProgram):
            data = self._buffer[: device.receive(self._buffer.data, MONITOR_READ_S)].tobytes()
        else:
            data = device.read(max(1, device.in_waiting))
        *lines, partial = re.split(rb"[\r\n]+", self._partial + data)
        self._partial = partial[-MAX_PARTIAL_BYTES:]
        for line in filter(bytes.strip, lines):
            values = self._lines.values(line)
            if values is not None:
                self._keep(values[0])
            elif self._value is not None:
                self._fault = f"the last line was {self._lines.refused}"

    def _keep(self, value: float) -> None:
        now_ns = time.monotonic_ns()
        self._due_ns = now_ns + to_ns(self.table.silent_s)
        self._value, self._fault = value, ""
        if self._timed and now_ns - self._kept_ns >= to_ns(self.table.period_s):
            self._kept_ns = now_ns
            self._readings.append((now_ns, value))

    def _lose(self, error: Exception) -> None:
        self.close()
        self._reopen_ns = time.monotonic_ns() + to_ns(REOPEN_SOURCE_S)
        self._fault = str(error)
