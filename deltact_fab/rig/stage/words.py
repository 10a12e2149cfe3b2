"""What a GRBL controller says: banner, settings, status, errors and alarms in plain words."""

from __future__ import annotations

import re

ERRORS = {
    1: "a letter is missing",
    2: "bad number",
    3: "unknown $ command",
    4: "negative value",
    5: "homing is off ($22=0)",
    7: "settings memory was unreadable and was reset",
    8: "only allowed when idle",
    9: "locked in an alarm or a jog",
    10: "soft limits need homing ($22=1)",
    11: "line too long",
    15: "target outside of the travel",
    16: "not a jog command",
    20: "unsupported command",
    22: "no feed rate",
}
ALARMS = {
    1: "hard limit: a switch was hit",
    2: "soft limit: a move would leave the travel",
    3: "reset while moving",
    6: "reset while homing",
    7: "door opened while homing",
    8: "homing: pull-off did not clear the switch",
    9: "homing: no switch found",
}

_NUMBER = r"(-?\d+(?:\.\d*)?)"
BANNER = re.compile(r"Grbl(?:HAL)? (\d+)\.(\d+)\S*", re.IGNORECASE)
SETTING = re.compile(rf"\$(\d+)={_NUMBER}")
STATUS = re.compile(rf"<([A-Za-z]+(?::\d)?)\|(M|W)Pos:{_NUMBER},{_NUMBER},{_NUMBER}(?:\|[^<>]*)?>")
RATE = re.compile(rf"\|FS?:{_NUMBER}[,|>]")


def explain(text: str, meanings: dict[int, str]) -> str:
    """`error:9` or `ALARM:2`, with its meaning where it is known."""
    number = text.partition(":")[2]
    known = meanings.get(int(number)) if number.isdigit() else None
    return f"{text} ({known})" if known else text
