"""A scale or load cell that writes lines of numbers to a serial port, for a lab without a Nano17.

One line is one sample; `[force.serial]` declares its columns. Samples are stamped on arrival, so
they are late by the delay of the scale and its adapter.
"""

from __future__ import annotations

import re
from contextlib import suppress
from typing import Any

import numpy as np

from deltact_fab.common import SensorError, to_ns

from ..interface import Clock, ForceSamples
from ..tables import ForceConfig, SerialScaleConfig
from .lines import LineReader, open_port
from .netft import NoteCounts
from .standstill import Standstill

FORCE_AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
FORCE_UNITS_N = {"N": 1.0, "mN": 1e-3, "g": 9.80665e-3, "kg": 9.80665}  # definition: 9.80665 m/s2
TORQUE_UNITS_NMM = {"Nmm": 1.0, "Nm": 1e3}  # definition
# By hand: longer times delay a press, shorter ones lose a slow scale or its resolution.
SCALE_COUNTS_PER_N, SCALE_COUNTS_PER_NMM = 1e6, 1e5  # finer than any scale
MAX_COUNT = 2**31 - 1  # of the record's int32
FIRST_LINE_S = 3.0  # an Arduino restarts when its port is opened
SCALE_TARE_S = 0.3
MIN_TARE_SAMPLES = 3
FINE_TARE_SAMPLES, MAX_REPEAT_SHARE = 50, 0.05  # a fine scale, which must not rest for SCALE_TARE_S
MAX_LINE_BYTES = 1024


class SerialScale:
    """Implements rig.interface.ForceSensor. The port is open from the start.

    Axes that the scale does not measure are zero; `identity` names its columns. A value beyond
    the range of the rig file is flagged as saturated. Raises SensorError if the port cannot be
    opened.
    """

    def __init__(self, config: ForceConfig, clock: Clock, port: Any = None) -> None:
        """port: open, of a simulated scale."""
        assert config.serial is not None, "the configuration has a serial scale"
        self._config: SerialScaleConfig = config.serial
        self._clock = clock
        table = self._config
        self._limits = np.array([*config.range_n, *config.range_nmm])
        self._per_unit = np.minimum(
            np.repeat([SCALE_COUNTS_PER_N, SCALE_COUNTS_PER_NMM], 3), MAX_COUNT / (2 * self._limits)
        )
        units = FORCE_UNITS_N[table.unit], TORQUE_UNITS_NMM[table.torque_unit]
        self._units = np.repeat(units, 3) * table.scale
        columns = enumerate(table.columns)
        self._columns = [(k, FORCE_AXES.index(name)) for k, name in columns if name != "-"]
        self._tare = np.zeros(6)
        self._partial = b""
        self._skip_line = True  # rest of a line that had begun before
        self._last_ns = 0
        self._since: tuple[int, int] = (0, 0)  # first stamp of the stream, samples since
        self._period_ns = 0.0
        self._lines = LineReader(table)
        self._standstill: Standstill | None = None
        self.tally = NoteCounts()
        self._port = port or open_port(
            "scale", "force.serial: port", table.port, table.baud, table.silent_s
        )
        self._has_sent = False

    def begin(self, stream: str) -> None:
        """Start, and take the mean of the unloaded readings as zero."""
        self._tare, self._standstill = np.zeros(6), None
        self.start()
        parts = [self.read()]
        first_ns = int(parts[0].t_ns[0])
        while (
            parts[-1].t_ns[-1] - first_ns < SCALE_TARE_S * 1e9
            or sum(len(part.t_ns) for part in parts) < MIN_TARE_SAMPLES
        ):
            parts.append(self.read())
        counts = np.concatenate([part.counts for part in parts])
        if any(part.saturated.any() for part in parts):
            raise SensorError(f"{self._config.port}: the scale is over its range without load")
        self._tare = np.asarray(counts.mean(axis=0) / self._per_unit)
        changed = np.diff(counts, axis=0).any(axis=1)
        if len(counts) >= FINE_TARE_SAMPLES and changed.mean() > 1 - MAX_REPEAT_SHARE:
            self._standstill = Standstill(to_ns(SCALE_TARE_S))

    def start(self) -> None:
        """Discard received data; send the request of a scale that needs one."""
        self._port_io(self._port.reset_input_buffer)
        self._partial, self._skip_line = b"", True
        self._since, self._period_ns = (0, 0), 0.0
        self._standstill = self._standstill and Standstill(to_ns(SCALE_TARE_S))
        if ask := self._config.ask:
            self._port_io(lambda: self._port.write(ask.encode("ascii")))

    def read(self) -> ForceSamples:
        """Return samples since the last read, at least one; waits for the next.

        Raises SensorError when no reading comes within `silent_s`, a fine scale's readings do not
        change, or the port is lost.
        """
        table = self._config
        limit_s = table.silent_s if self._has_sent else max(FIRST_LINE_S, table.silent_s)
        deadline_ns = self._clock.now_ns() + to_ns(limit_s)
        while True:
            data = self._port_io(lambda: self._port.read(max(1, self._port.in_waiting)))
            now_ns = self._clock.now_ns()
            rows = self._rows(data)
            if rows:
                self._has_sent = True
                return self._samples(np.array(rows), now_ns)
            if now_ns >= deadline_ns:
                self.tally.add("silence", 1)
                refused = self._lines.refused
                hint = f"the last line was {refused}" if refused else "no line came"
                raise SensorError(
                    f"{table.port}: no reading within {limit_s:g} s: {hint}; check the cable, "
                    "[force.serial] baud, unit and columns"
                )

    def stop(self) -> None:
        """Do nothing: the next start discards lines received until then."""

    def identity(self) -> dict[str, Any]:
        table = self._config
        rate_hz = round(1e9 / self._period_ns, 1) if self._period_ns else None
        return {
            "kind": "serial",
            "port": table.port,
            "baud": table.baud,
            "columns": list(table.columns),
            "unit": table.unit,
            "scale": table.scale,
            "rate_hz": rate_hz,
        }

    def close(self) -> None:
        with suppress(OSError):
            self._port.close()

    def _port_io(self, operation: Any) -> Any:
        """Run a port operation; a lost port raises SensorError."""
        try:
            return operation()
        except (OSError, TypeError) as error:  # pyserial reads from no descriptor once it is closed
            raise SensorError(f"{self._config.port}: lost the scale's port: {error}") from error

    def _rows(self, data: bytes) -> list[list[float]]:
        """Return rows of six values from the lines that are complete."""
        *lines, self._partial = re.split(rb"[\r\n]+", self._partial + data)
        if len(self._partial) > MAX_LINE_BYTES:
            self.tally.add("garbage", 1)
            self._partial, self._skip_line = b"", True
        rows = []
        for line in lines:
            if self._skip_line:
                self._skip_line = False
                continue
            if not line.strip():
                continue
            if (numbers := self._lines.values(line)) is None:
                self.tally.add("garbage", 1)
                continue
            row = [0.0] * 6
            for column, axis in self._columns:
                row[axis] = numbers[column]
            rows.append(row)
        return rows

    def _samples(self, rows: np.ndarray[Any, Any], now_ns: int) -> ForceSamples:
        values = rows * self._units
        saturated = np.asarray((np.abs(values) > self._limits).any(axis=1))
        counts = np.clip(np.rint((values - self._tare) * self._per_unit), -MAX_COUNT, MAX_COUNT)
        # Lines received together were written one period apart.
        back = np.arange(len(rows) - 1, -1, -1) * self._period_ns
        t_ns = np.maximum(now_ns - np.rint(back).astype(np.int64), self._last_ns + 1)
        t_ns = np.maximum.accumulate(t_ns - np.arange(len(rows))) + np.arange(len(rows))
        self._last_ns = int(t_ns[-1])
        first_ns, count = self._since
        self._since = (first_ns or now_ns, count + len(rows))
        if first_ns:
            self._period_ns = (now_ns - first_ns) / (self._since[1] - 1)
        self.tally.add("saturation", int(saturated.sum()))
        if self._standstill is not None:
            self._standstill.check(t_ns, counts, saturated)
        return ForceSamples(
            t_ns,
            counts.astype(np.int32),
            self._per_unit,
            saturated,
            notes=self.tally.pop_notes(now_ns),
        )
