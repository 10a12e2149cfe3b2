"""Lines of scales: a reading, or refused with the line and the key that would read it."""

from __future__ import annotations

import random
import re
from typing import Any

import pytest

from deltact_fab.bench.rig.force.lines import FIRST_LINES, LineReader
from deltact_fab.bench.rig.tables import SerialScaleConfig


def reader(first: str = "", **own: Any) -> LineReader:
    """A reader that has had the first lines."""
    made = LineReader(SerialScaleConfig(port="x", **{"unit": "g", **own}))
    for _ in range(FIRST_LINES if first else 0):
        made.values(first.encode())
    return made


@pytest.mark.parametrize(
    ("line", "unit", "value"),
    [
        ("40.8", "g", 40.8), ("40.8 g", "g", 40.8), ("Reading: 40.8 g", "g", 40.8), ("41", "g", 41),
        ("ST,GS,+  0.0408kg", "kg", 0.0408), ("+ 40.8", "g", 40.8), ("-.5", "g", -0.5),
        ("1e-3", "g", 1e-3), ("  1.N", "N", 1), ("HX711 reading: 40.8", "g", 40.8),
        ("S S     -40.8 g", "g", -40.8), ("N     -   40.8 g  ", "g", -40.8),
        ("G- 40.8", "g", -40.8), ("40.8 g ?", "g", 40.8), ("[\t40.8];", "g", 40.8),
        ("\x0240.8 KG\x03", "kg", 40.8), ("No. 40.8", "g", 40.8),
    ],
)  # fmt: skip
def test_whole_line_is_a_reading(line: str, unit: str, value: float) -> None:
    made = reader(line, unit=unit)
    assert made.values(line.encode()) == [value]
    assert reader(unit=unit).values(line.encode()) is None  # its words came once


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("HX711 not found.", "reports an error"), ("HX711", "no number"), ("", "no number"),
        ("Error 5", "reports an error"), ("OL", "reports an error"), ("nan", "no number"),
        ("-inf", "no number"), ("1e999", "too large a number"),
        ("40,8", "a comma in a number? Set the scale to points only"),
        ("1,040.8", "2 numbers, .* a comma in a number?"),
        ("1040.8,100", 'columns = ["fz", "-"] would read the first'),
        ("1040.8 100", 'columns = ["fz", "-"] would read the first'),
        ("40.8 kg", 'force.serial.unit is "g", and the line is in kg: set unit = "kg"'),
        ("40.8lb", "the line is in lb: set the scale to g"),
        ("40.8 Nm", "the line is in Nm: set the scale to g"),
        ("0x1F", "digits that are no number"), ("40.8.3", "digits that are no number"),
        ("40.8e", "digits that are no number"), ("1.2.3.4", "digits that are no number"),
        ("+-40.8-", "digits that are no number"), ("HX-711", "no number"),
        ("40.8 foo", "its words are not those of the first lines"),
    ],
)  # fmt: skip
def test_other_line_is_refused_by_name(line: str, why: str) -> None:
    made = reader("40.8 g")
    assert made.values(line.encode()) is None
    assert re.search(re.escape(why).replace(r"\.\*", ".*"), made.refused), made.refused
    assert made.refused.startswith(f"{line!a}: ")
    assert made.values(b"1 g") == [1]


def test_units_and_words_of_several_columns() -> None:
    made = reader("5 ms, 1.5 N, -2 Nmm", columns=("-", "fz", "tx"), unit="N")
    assert made.values(b"6 ms, 2.5 N, -3 Nmm") == [6, 2.5, -3]
    assert made.values(b"6 ms, 2.5 N, -3 Nm") is None
    assert 'force.serial.torque_unit is "Nmm"' in made.refused
    assert made.values(b"2.5 N, -3 Nmm") is None
    assert "2 numbers, and force.serial.columns has 3;" in made.refused + ";"


@pytest.mark.parametrize("line", ["US,GS,+  0.0419kg", "OL,GS,+  0.0419kg", "ST,NT,+  0.0419kg"])
def test_moving_load_is_read(line: str) -> None:
    values = reader("ST,GS,+  0.0408kg", unit="kg").values(line.encode())
    assert values == ([0.0419] if line.startswith("US") else None)


WORDS = {"ST", "US", "GS", "S", "D", "SD", "Reading:", "g", "gf", "", "G", "GF"}
FIRST = ["40.8 g", "ST,GS,+   40.8g", "Reading: 40.8 g", "+ 40.8", "-.5", "1e-3", "S S   40.8 g"]
OTHERS = [
    "HX711 not found.", "Error 711", "OL", "40,8 g", "1.040,8 g", "1'040.8 g", "４０.８ g", "NaN",
    "40.8 kg", "0.0408 kg", "Reading: --", "reset 3", "1e400", "+++", "12:30:05 40.8 g", "٤٠٫٨ g",
]  # fmt: skip


def strict(line: bytes) -> float:
    """The only token of a line that is no known word, as a number. Raises ValueError."""
    apart = re.sub(r"(?<=[A-Za-z])(?=[+-][ \t])|(?<=Reading:)", " ", line.decode("ascii"))
    tokens = re.split(r"[ \t,;?*\r\f\v]+", apart)
    text = "".join(token for token in tokens if token not in WORDS)
    if "_" in text:
        raise ValueError(line)
    return float(re.sub("(?i)gf?$", "", text))


@pytest.mark.parametrize("first", FIRST)
def test_fuzzed_lines_give_no_nonsense(first: str) -> None:
    draw, made, n_read = random.Random(first), reader(first), 0
    alphabet = "0123456789+-.,eE gkNSTU?HX \t;:\0\x7fé"
    for _ in range(20_000 // len(FIRST) + 1):
        line, kind = re.sub(r"40\.8|\.5|1(?=e)", str(draw.randrange(999) / 8), first), draw.random()
        for _ in range(draw.randrange(4)):
            k, n = draw.randrange(len(line) + 1), draw.randrange(2)
            line = line[:k] + draw.choice(alphabet) * n + line[k + draw.randrange(2) :]
        data = (line if kind > 0.2 else draw.choice(OTHERS)).encode()
        data = draw.randbytes(draw.randrange(20)) if kind > 0.9 else data
        if (values := made.values(data)) is not None:
            n_read += 1
            assert values == [strict(data)], data
        else:
            assert made.refused
    assert n_read > 500
