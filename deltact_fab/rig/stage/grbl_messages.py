"""What a GRBL controller says: banner, settings, status, errors and alarms in plain words."""

from __future__ import annotations

import re

ERRORS = {
    1: "a letter is missing",
    2: "bad number",
    3: "unknown $ command",
    4: "negative value",
    5: "homing is off ($22=0)",
    6: "step pulse too short",
    7: "settings memory was unreadable and was reset",
    8: "only allowed when idle",
    9: "locked in an alarm or a jog",
    10: "soft limits need homing ($22=1)",
    11: "line too long",
    12: "step rate too high",
    13: "the safety door is open",
    15: "target outside of the travel",
    16: "not a jog command",
    17: "laser mode needs a PWM output",
    18: "a switch is still pressed, or an emergency stop",
    20: "unsupported command",
    22: "no feed rate",
}
# 1 to 9 of GRBL 1.1, the rest of grblHAL.
ALARMS = {
    1: "hard limit: a switch was hit",
    2: "soft limit: a move would leave the travel",
    3: "reset while moving: steps may be lost",
    4: "probe: not in its first state",
    5: "probe: no contact",
    6: "reset while homing",
    7: "door opened while homing",
    8: "homing: pull-off did not clear the switch",
    9: "homing: no switch found",
    10: "emergency stop is pressed",
    11: "homing is required",
    12: "a limit switch is pressed: release it",
    13: "probe protection was triggered",
    14: "spindle: not at speed",
    15: "homing: the second motor of an axis found no switch",
    16: "self test failed",
    17: "a motor driver reports a fault",
    18: "homing failed: axis position unknown",
}
STATES = {
    "Hold": "feed hold",
    "Door": "safety door",
    "Door:0": "safety door, closed again",
    "Door:1": "the safety door is open",
    "Door:2": "safety door, coming to rest",
    "Door:3": "safety door, going back from its parking place",
    "Check": "check mode: lines are read, nothing moves",
    "Tool": "waiting for a tool change",
    "Sleep": "asleep: only a reset wakes it",
}

_NUMBER = r"(-?\d+(?:\.\d*)?)"
BANNER = re.compile(r"Grbl(?:HAL)? (\d+)\.(\d+)\S*", re.IGNORECASE)
SETTING = re.compile(rf"\$(\d+)={_NUMBER}")
STATUS = re.compile(rf"<([A-Za-z]+(?::\d+)?)\|(M|W)Pos:{_NUMBER},{_NUMBER},{_NUMBER}(?:\|[^<>]*)?>")
OPTIONS = re.compile(r"\[OPT:([^,\]]*)")


def explain(text: str, meanings: dict[int, str]) -> str:
    """`error:9` or `ALARM:2`, with its meaning where it is known."""
    number = text.partition(":")[2]
    known = meanings.get(int(number)) if number.isdigit() else None
    return f"{text} ({known})" if known else text


def state_in_words(state: str) -> str:
    """`Door:1 (the safety door is open)`; an alarm's number in its words."""
    name, _, number = state.partition(":")
    if name == "Alarm" and number.isdigit() and int(number) in ALARMS:
        return f"{state} ({ALARMS[int(number)]})"
    known = STATES.get(state) or STATES.get(name)
    return f"{state} ({known})" if known else state
