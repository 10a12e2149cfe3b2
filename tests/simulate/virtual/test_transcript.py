"""The simulated controller against the answers of GRBL 1.1h itself, case by case.

tests/data/grbl-1.1h-transcript.json holds what unmodified firmware answered, built from its
sources and put on a board with switches and a counted carriage.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from deltact_fab.simulate.virtual.clock import VirtualClock
from deltact_fab.simulate.virtual.controller import GrblController

DATA = json.loads((Path(__file__).parents[2] / "data" / "grbl-1.1h-transcript.json").read_text())
CASES: list[dict[str, Any]] = DATA["cases"]
SETTINGS = {int(n): value for n, value in DATA["settings"].items()}
# What whoever wrote the transcript took to write and read, beyond the waits that it gives: in
# '$ while Run' a move of 1.0 s is over when 0.9 s of waits are, and not before 0.7 s.
OVERHEAD_S = 0.05
IDLE = "<Idle|MPos:-1.000,-1.000,-1.000|Bf:15,128|FS:0,0|"

# Case and exchange whose answer gives a place that depends on when a byte arrived.
IN_MOTION = {("jog cancel", 2), ("homing reset", 4)}
# What the simulator knows: jogs, homing, settings, sleep, realtime bytes. It runs no program.
JOGS = re.compile(r"([?!~\x18\x84\x85]|(\$(J.*|H.*|\$|I|X|SLP|\d+=.*))?\n)*")


def answers(case: dict[str, Any]) -> list[str]:
    clock = VirtualClock()
    grbl = GrblController(SETTINGS, clock)
    clock.sleep_s(2)
    if case["homed"]:
        grbl.write(b"$H\n")
        clock.sleep_s(30)
    grbl.take_output()
    said = []
    for exchange in case["exchanges"]:
        grbl.write(exchange["send"].encode("latin-1"))
        clock.sleep_s(exchange["wait_s"] + OVERHEAD_S)
        said.append(grbl.read_available().decode().replace("\r\n", "\n").strip())
    return said


def without_numbers(answer: str) -> str:
    return re.sub(r"-?\d+\.\d+", "N", answer)


def jogs(case: dict[str, Any]) -> bool:
    return all(JOGS.fullmatch(exchange["send"]) for exchange in case["exchanges"])


@pytest.mark.parametrize("case", [c for c in CASES if jogs(c)], ids=lambda case: case["name"])
def test_it_answers_as_the_firmware_does(case: dict[str, Any]) -> None:
    for k, (exchange, ours) in enumerate(zip(case["exchanges"], answers(case), strict=True)):
        firmware = exchange["answer"]
        if (case["name"], k) in IN_MOTION:
            ours, firmware = without_numbers(ours), without_numbers(firmware)
        assert ours == firmware
