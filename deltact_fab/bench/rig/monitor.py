"""Monitors of a bench's surroundings: temperature, humidity, light, as lines of numbers.

A program writes the lines to its standard output, or a device to a serial port; a thread of the run
reads them. Tables with one command or one port share it: its lines have a number for each, in the
order of the rig file. A reading beyond its limits pauses the run, and so does an unknown one: of a
source that ended, is silent or wrote what is no reading. A source that ended is opened again.
"""

from __future__ import annotations

import re
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import DeltactFabError, InputError, SensorError, to_ns

from ..record.streams import MONITOR_PREFIX, Chunk
from .force.lines import FIRST_LINES, LineReader
from .program import ChildProgram
from .tables import MonitorConfig

# By hand: longer times delay the end of a run or a source's return, shorter ones load the host.
MONITOR_READ_S = 0.1
REOPEN_SOURCE_S = 2.0
MAX_TEXT_BYTES = 1024  # by hand: of a line


class Monitor:
    """Readings of one `[[monitor]]`, put in by a thread and taken by the run's."""

    def __init__(self, table: MonitorConfig) -> None:
        self.table = table
        self.timed = True
        """Every reading is kept with its time; False: the newest one at each press (lockstep)."""
        self.lost = "not started"
        """Reason why its source cannot be read, "" if it can."""
        self._value: float | None = None
        self._refused = self._news = ""
        self._told = False
        self._kept_ns = self._due_ns = 0
        self._readings: deque[tuple[int, float]] = deque()

    def start(self) -> None:
        """Await the first reading; a serial source has to repeat it."""
        self.lost = ""
        self._due_ns = time.monotonic_ns() + to_ns(FIRST_LINES * self.table.silent_s)

    def put(self, value: float | None, refused: str = "") -> None:
        """Take a reading, or None for a line that is none, with the reason."""
        t_ns = time.monotonic_ns()
        self._refused = refused
        if value is not None:
            self.lost, self._value = "", value
            self._due_ns = t_ns + to_ns(self.table.silent_s)
            if self.timed and t_ns - self._kept_ns >= to_ns(self.table.period_s):
                self._kept_ns = t_ns
                self._readings.append((t_ns, value))
        self._news = self._news or self.problem()

    @property
    def awaited(self) -> bool:
        """True until the first reading or its time limit."""
        return self._value is None and not self.problem()

    def problem(self) -> str:
        """Reason why its value is unknown or beyond its limits, "" for none."""
        return self._unknown() or self._outside()

    def hindrance(self) -> str:
        """Return the problem that pauses the run, "" for none; it is then no news."""
        unknown, required = self._unknown(), self.table.required
        if required:
            self.news()
        return unknown * required if unknown else self._outside()

    def news(self) -> str:
        """Return the first problem since the last call, if there was none then."""
        found, self._news = self._news or self.problem(), ""
        told, self._told = self._told, bool(self.problem())
        return "" if told else found

    def mark(self, t_ns: int) -> None:
        """Keep the newest known reading under this time, alone."""
        self._readings.clear()
        if self._value is not None and not self._unknown():
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
        name, reason = self.table.name, f": the last line was {self._refused}"
        if self.lost:
            return f"{name}: {self.lost}"
        if time.monotonic_ns() > self._due_ns:
            return (
                f"{name}: no reading within {self.table.silent_s:g} s"
                f"{reason if self._refused else ''}"
            )
        return f"{name}{reason}" if self._refused and self._value is not None else ""

    @property
    def text(self) -> str:
        """Newest reading with name and unit; "" before the first."""
        if self._value is None:
            return ""
        return f"{self.table.name} = {self._value:g} {self.table.unit}".rstrip()

    def _outside(self) -> str:
        low, high, value = self.table.min, self.table.max, self._value
        if value is not None and low is not None and value < low:
            return f"{self.text}, below min = {low:g}"
        if value is not None and high is not None and value > high:
            return f"{self.text}, above max = {high:g}"
        return ""


class MonitorSource:
    """A command or serial port, opened by `start` and read by the thread that calls `step`."""

    def __init__(self, tables: Sequence[MonitorConfig], folder: Path) -> None:
        """tables: of this source. folder: of the rig file."""
        self.monitors = [Monitor(table) for table in tables]
        self.name = f"monitor {tables[0].name}"
        self._table, self._folder = tables[0], folder
        n = len(tables)
        # A program writes numbers alone; a device may write words, the same in every line.
        words = b"\0" * n if self._table.command is not None else None
        self._lines = LineReader(None, ("-",) * n, words)
        self._device: ChildProgram | Any = None  # Any: pyserial has no types
        self._reopen_ns = 0
        self._partial, self._skip_line = b"", False

    def start(self, timed: bool) -> None:
        """Open it. Raises InputError for a faulty table, SensorError if a value is required.

        timed: see `Monitor.timed`.
        """
        for monitor in self.monitors:
            monitor.timed = timed
            monitor.start()
        try:
            self._open()
        except SensorError as error:
            if any(monitor.table.required for monitor in self.monitors):
                raise
            self._lose(error)

    def step(self) -> None:
        """Read what has come, waiting up to MONITOR_READ_S; open a lost source again."""
        try:
            if self._device is None:
                time.sleep(MONITOR_READ_S)
                if time.monotonic_ns() < self._reopen_ns:
                    return
                self._open()
            data = self._read()
        except (DeltactFabError, OSError, TypeError) as error:  # TypeError: pyserial, once closed
            self._lose(error)
            return
        *lines, self._partial = re.split(rb"[\r\n]+", self._partial + data)
        if len(self._partial) > MAX_TEXT_BYTES:
            lines, self._partial = [*lines, self._partial[:MAX_TEXT_BYTES]], b""
        for line in lines:
            skipped, self._skip_line = self._skip_line, False
            if line.strip() and not skipped:
                self._put(self._lines.values(line))

    def close(self) -> None:
        """End the program or close the port; idempotent."""
        device, self._device = self._device, None
        if device is not None:
            with suppress(OSError):
                device.close()

    def _put(self, values: list[float] | None) -> None:
        for k, monitor in enumerate(self.monitors):
            monitor.put(None if values is None else values[k], self._lines.refused)

    def _open(self) -> None:
        name, port = self._table.name, self._table.port
        self._partial, self._skip_line = b"", port is not None  # a line may have begun before
        if self._table.command is not None:
            key = f"monitor.{name}.command"
            self._device = ChildProgram(
                self._table.command[0], key, self._table.command, self._folder
            )
            return
        import serial

        exclusive = {} if "://" in str(port) else {"exclusive": True}
        try:
            self._device = serial.serial_for_url(
                port, baudrate=self._table.baud, timeout=MONITOR_READ_S, **exclusive
            )
        except ValueError as error:
            raise InputError(f"monitor.{name}.port: {port}: not a serial port: {error}") from error
        except OSError as error:
            raise SensorError(f"monitor.{name}.port: {port}: cannot be opened: {error}") from error

    def _read(self) -> bytes:
        if isinstance(self._device, ChildProgram):
            return self._device.read(MONITOR_READ_S)
        return bytes(self._device.read(max(1, self._device.in_waiting)))

    def _lose(self, error: Exception) -> None:
        self.close()
        self._reopen_ns = time.monotonic_ns() + to_ns(REOPEN_SOURCE_S)
        for monitor in self.monitors:
            monitor.lost = str(error)


def monitor_sources(
    tables: Sequence[MonitorConfig] | None, folder: Path
) -> tuple[MonitorSource, ...]:
    """Return the sources of a rig file's monitors; nothing is opened. folder: of the rig file."""
    shared: dict[Any, list[MonitorConfig]] = {}
    for table in tables or ():
        shared.setdefault(table.command or table.port, []).append(table)
    return tuple(MonitorSource(group, folder) for group in shared.values())
