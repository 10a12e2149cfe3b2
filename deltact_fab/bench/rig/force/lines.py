"""Lines of a scale: one is a reading only if the whole of it is understood.

It is numbers, separators, at most one unit after each number, and the words of the first lines.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from typing import Any

import serial

from deltact_fab.common import InputError, SensorError

from ..tables import SerialScaleConfig

# In lower case, with the rig file's name, "" where it has none.
UNIT_NAMES = dict.fromkeys(["kn", "mg", "lb", "lbs", "lbf", "oz", "ozf", "ct", "ms", "mv"], "")
UNIT_NAMES |= {"n": "N", "mn": "mN", "g": "g", "gf": "g", "kg": "kg", "kgf": "kg"}
UNIT_NAMES |= {"nm": "Nm", "nmm": "Nmm"}
# Digits after a letter are part of a word, as in HX711; a sign may stand apart from its digits.
NUMBER_PATTERN = re.compile(
    r"(?:(?<![\w.+-])|(?<=\d)(?=[-+])|(?<=[A-Za-z])(?=[-+][ \t]))"
    r"([-+]?[ \t]*(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    rf"(?:[ \t]*((?i:{'|'.join(UNIT_NAMES)}))(?!\w))?(?![\w.]|[-+](?![\d.]))".encode()
)
# Marks of a moving load that change from line to line: A&D, CAS, Kern, Mettler SICS, Ohaus.
STABILITY_PATTERN = re.compile(rb"(?<!\w)(?:(?:ST|US|SD|S|D|STABLE|UNSTABLE)(?!\w)|[?*])")
ERROR_PATTERN = re.compile(
    rb"(?i)(?<![a-z])(?:err(?:ors?)?|fail(?:ed|ure)?|not|timeout|over(?:load)?|under(?:load)?"
    rb"|[ou]l|invalid|missing|retry)(?![a-z])"
)
WORD_PATTERN = re.compile(rb"[A-Za-z_][\w.+-]*")
NUMBER_COMMA = re.compile(rb"(?<![.\d])(?:\d+,\d+(?![.\d])|\d{1,3},\d{3}(?!\d))")
FIRST_LINES = 3  # by hand: equal words so often are the scale's; a greeting is said once
SHOWN_BYTES = 60  # by hand: of a line in a message


def open_port(owner: str, key: str, port: str, baud: int, timeout_s: float) -> Any:
    """Open a serial port, for this process alone. owner: device. key: of the rig file.

    Raises InputError for a name that is no port, SensorError for one that cannot be opened.
    """
    exclusive = {} if "://" in port else {"exclusive": True}
    try:
        return serial.serial_for_url(port, baudrate=baud, timeout=timeout_s, **exclusive)
    except ValueError as error:
        raise InputError(f"{key}: {port}: not a serial port: {error}") from error
    except OSError as error:
        raise SensorError(f"{port}: cannot open the {owner}'s port: {error}") from error


class LineReader:
    """Reader of the lines of one scale. refused: the last line if it is no reading, and
    why."""

    def __init__(self, config: SerialScaleConfig | None, words: bytes | None = None) -> None:
        """config: None for one number of any unit. words: around the numbers, if known."""
        self._config = config
        self._columns = ("-",) if config is None else config.columns
        self._first: Counter[bytes] = Counter()
        self._words = words
        self.refused = ""

    def values(self, line: bytes) -> list[float] | None:
        """Return the numbers of a line; None for one that is no reading."""
        numbers = NUMBER_PATTERN.findall(line)
        rest = NUMBER_PATTERN.sub(b"\0", line)
        words = re.sub(rb"\s*\0\s*", b"\0", STABILITY_PATTERN.sub(b"", rest))
        words = b" ".join(words.split())
        values = [float(b"".join(number.split())) for number, _ in numbers]
        fault = self._fault(line, rest, [unit.decode() for _, unit in numbers])
        if not fault and not all(map(math.isfinite, values)):
            fault = "too large a number"
        if not fault and self._words is None:
            self._first[words] += 1
            self._words = words if self._first[words] >= FIRST_LINES else None
        if not fault and words != self._words:
            fault = "its words are not those of the first lines"
        quoted = ascii(line[:SHOWN_BYTES].decode("latin-1"))
        self.refused = f"{quoted}: {fault}" if fault else ""
        return None if fault else values

    def _fault(self, line: bytes, rest: bytes, units: list[str]) -> str:
        """Reason why a line is no reading, with the key that would read it, or ""."""
        columns = self._columns
        if ERROR_PATTERN.search(line):
            return "reports an error"
        if re.search(rb"\d", WORD_PATTERN.sub(b"", rest)):
            return "digits that are no number"
        if self._config is None and len(units) > 1:
            return f"{len(units)} numbers; a monitor has one"
        if len(units) != len(columns):
            return _count_fault(line, len(units), columns)
        for column, unit in zip(columns, units, strict=True):
            key = "unit" if column.startswith("f") else "torque_unit"
            right, name = getattr(self._config, key, ""), UNIT_NAMES.get(unit.lower())
            if name not in (None, right) and column != "-":
                fits = name and name.startswith("Nm") == (key == "torque_unit")
                remedy = f'set {key} = "{name}"' if fits else f"set the scale to {right}"
                return f'force.serial.{key} is "{right}", and the line is in {unit}: {remedy}'
        return ""


def _count_fault(line: bytes, n: int, columns: tuple[str, ...]) -> str:
    if not n:
        return "no number"
    text = f"{n} numbers, and force.serial.columns has {len(columns)}"
    if n == 2 * len(columns) and NUMBER_COMMA.search(line):
        return f"{text}: a comma in a number? Set the scale to points only"
    names = ", ".join(f'"{name}"' for name in (*columns, *"-" * (n - len(columns))))
    return text if n < len(columns) else f"{text}: columns = [{names}] would read the first"
