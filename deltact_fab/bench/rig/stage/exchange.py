"""Serial protocol of a GRBL controller: one line outstanding, every line answered; texts of its
errors, alarms and states.

Independent of moves. Events that the host must react to are raised as `TalkFault`.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from ..interface import StageState
from .port import READ_SLICE_S, Port

SOFT_RESET = b"\x18"
# By hand: longer waits find a dead controller later, shorter ones blame a slow one.
RESET_BANNER_S = 1.0  # from a reset to the banner, half a second of it for the message of an alarm
LINE_QUIET_S = 0.2  # without a line: the answer is complete
BANNER_S = 2.5  # an Arduino's boot loader takes up to 2 s
LINE_ANSWER_S = 1.0
STATUS_S = 0.5  # `?` is answered within milliseconds
LISTEN_S = 2.0  # after silence: for the banner of a restart
ERROR_TEXTS = {
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
ALARM_TEXTS = {
    1: "hard limit: a switch was hit",
    2: "soft limit: a move would leave the travel",
    3: "reset while moving: steps may be lost",
    4: "probe: not in its initial state",
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
STATE_TEXTS = {
    "Hold": "feed hold",
    "Door": "safety door",
    "Door:0": "safety door, closed again",
    "Door:1": "the safety door is open",
    "Door:2": "safety door, decelerating",
    "Door:3": "safety door, returning from parking",
    "Check": "check mode: lines are read, nothing moves",
    "Tool": "waiting for a tool change",
    "Sleep": "asleep: needs a reset",
}
DECIMAL_PATTERN, COORDINATE_PATTERN = r"(-?\d{1,9}(?:\.\d{0,9})?)", r"(-?\d{1,6}\.\d{3})"
BANNER_PATTERN = re.compile(r"Grbl(?:HAL)? (\d{1,3})\.(\d{1,3})\S{0,9}", re.IGNORECASE)
SETTING_PATTERN = re.compile(rf"\$(\d+)={DECIMAL_PATTERN}(?:\s+\(.*\))?")
STATUS_PATTERN = re.compile(  # of three axes or more, the first of which are X, Y and Z
    r"<((?:Idle|Run|Jog|Hold|Home|Alarm|Door|Check|Sleep|Tool)(?::\d{1,3})?)\|MPos:"
    rf"{','.join([COORDINATE_PATTERN] * 3)}(?:,-?[\d.]+)*(?:\|[^<>\ufffd]*)?>"
)
REFUSED_FIELDS = {  # of a status
    "|MPG:1": "a pendant has control of the stage: release it",
    "|WPos:": "status reports give the work position; set $10=1 or $10=3",
}
LONGEST_QUOTE = 60  # by hand: characters of an answer in a message
OPTIONS_PATTERN = re.compile(r"\[OPT:([^,\]]*)")


class TalkFault(Exception):
    """A fault in the communication. position_lost: the position is in doubt."""

    def __init__(self, reason: str, *, position_lost: bool = False) -> None:
        super().__init__(reason)
        self.reason = reason
        self.position_lost = position_lost


class LineRefused(TalkFault):
    """A line was answered by an error. number: of the error."""

    def __init__(self, line: str, text: str) -> None:
        super().__init__(f"{line} was refused: {explain(text, ERROR_TEXTS)}")
        self.number = text.partition(":")[2]


class NoAnswer(TalkFault):
    """A line was not answered in time by ok or an error."""


class Talk:
    """Commands and queries over one port. Raises TalkFault, and LinkLost of the port.

    posted: the line whose answer is pending, and when it was sent (ns).
    """

    def __init__(self, port: Port) -> None:
        self._port = port
        self.posted: tuple[str, int] | None = None
        self.unread: list[str] = []
        """Other lines that came after the last `peek_status`."""
        self._beats_baud = False  # answers faster than the baud rate: native USB

    def banner(self, limit_s: float = BANNER_S) -> list[str]:
        """Wait for a banner; return it, lines before it and lines after it; [] if none comes.

        The lines before it are printed by the first boot.
        """
        deadline = self._port.deadline_ns(limit_s)
        boot_lines: list[str] = []
        while (text := self._port.line(deadline)) is not None:
            if match := BANNER_PATTERN.search(text):
                return [text[match.start() :], *boot_lines, *self._read_until_quiet()]
            boot_lines.append(text)
        return []

    def reset(self) -> list[str]:
        """Reset (0x18); return the banner and further lines; [] without a banner."""
        self.posted = None
        # Within half a second of an alarm a reset is ignored, and the banner of an earlier one
        # may still be arriving: neither is an error.
        for limit_s in (RESET_BANNER_S, LISTEN_S):
            self._port.write(SOFT_RESET)
            if lines := self.banner(limit_s):
                return lines
        return []

    def peek_status(self) -> StageState | None:
        """Query the state, None without an answer that can be used; `unread` has the others."""
        self.unread = []
        self._port.write(b"?")
        deadline = self._port.deadline_ns(LINE_ANSWER_S)
        while (text := self._port.line(deadline)) is not None:
            if (match := STATUS_PATTERN.fullmatch(text)) and not _refusal(text):
                at_mm = float(match[2]), float(match[3]), float(match[4])
                return StageState(at_mm, match[1], self._port.now_ns() / 1e9)
            self.unread.append(text)
        self.unread += filter(None, [self._port.unfinished])
        return None

    def late_banner(self) -> list[str]:
        """Return a banner that came after `peek_status`, as `banner`; raise for other answers."""
        lines = [text for text in self.unread if BANNER_PATTERN.search(text)]
        if self.unread and not lines:
            raise TalkFault(_unusable(self.unread))
        return lines

    def post(self, line: str) -> None:
        """Send a line without waiting for its answer; requires that none is posted."""
        self.posted = line, self._port.now_ns()
        self._port.write(line.encode("ascii") + b"\n")

    def settle(self, limit_s: float) -> list[str] | None:
        """Wait for the answer to the posted line; return the lines before it, None without one."""
        deadline = self._port.deadline_ns(limit_s)
        data: list[str] = []
        while self.posted is not None:
            if (text := self._port.line(deadline)) is None:
                return None
            self._handle_line(text)
            data.append(text)
        return data[:-1]

    def forget_posted(self) -> None:
        """Discard the posted line and lines still arriving."""
        self.posted = None
        for text in self._read_until_quiet():
            _raise_for_event(text)

    def command(self, line: str, limit_s: float = LINE_ANSWER_S) -> list[str]:
        """Send a line, wait for its ok, return the lines before it.

        Raises NoAnswer; the line stays posted, as its answer may come later.
        """
        self.drain()
        if self.settle(limit_s) is None:
            self.forget_posted()
        sent_ns = self._port.now_ns()
        self.post(line)
        if (data := self.settle(limit_s)) is None:
            raise NoAnswer(f"no answer to {line} within {limit_s:.1f} s", position_lost=True)
        length = sum(len(answer) + len("\r\n") for answer in data)
        self._beats_baud |= self._port.now_ns() - sent_ns < self._port.on_wire_ns(length)
        return data

    def status(self, on_silence: Callable[[], str]) -> StageState:
        """Request one status report.

        After a second unanswered request on_silence is called to stop the motion and returns the
        outcome as text. Then the banner of a restart is waited for.
        """
        port = self._port
        self.drain()
        stopped, unread = "", []
        # Time of the first request: the answer after a second one may still belong to it.
        asked_ns = port.now_ns() + port.on_wire_ns(1)
        for limit_s in (STATUS_S, STATUS_S, LISTEN_S):
            if limit_s == LISTEN_S:
                stopped = on_silence()
            port.write(b"?")
            deadline = port.deadline_ns(limit_s)
            while (text := port.line(deadline)) is not None:
                self._handle_line(text)
                match = STATUS_PATTERN.fullmatch(text)
                if match is None:
                    unread += [text] if "<" in text or ">" in text else []
                elif not stopped:
                    t_s, within_s = self._position_time(asked_ns, len(text) + len("\r\n"))
                    at_mm = float(match[2]), float(match[3]), float(match[4])
                    return StageState(at_mm, match[1], t_s, within_s)
        silent = f"no answer to '?' within {2 * STATUS_S:g} s"
        raise TalkFault(f"{_unusable(unread) or silent}{stopped}", position_lost=True)

    def handle_received(self) -> None:
        """Handle the complete lines received so far, without waiting."""
        for text in self._port.received_lines():
            self._handle_line(text)

    def drain(self) -> None:
        """Handle lines since the last exchange, so that they are not taken for an answer."""
        while self._port.waiting:
            text = self._port.line(self._port.deadline_ns(READ_SLICE_S))
            if text is not None:
                self._handle_line(text)

    def _handle_line(self, text: str) -> None:
        """Handle the answer to the posted line; raise for alarms and restarts."""
        if self.posted is not None and (text == "ok" or text.startswith("error:")):
            (line, _), self.posted = self.posted, None
            if text != "ok":
                raise LineRefused(line, text)
        _raise_for_event(text)

    def _read_until_quiet(self) -> list[str]:
        lines = []
        while (text := self._port.line(self._port.deadline_ns(LINE_QUIET_S))) is not None:
            lines.append(text)
        return lines

    def _position_time(self, asked_ns: int, n: int) -> tuple[float, float]:
        """Time (s) of the position in an answer of n bytes complete now, and its uncertainty.

        It was read between the request and the answer's first byte, which is older than now by
        the time on the wire, unless the link was ever faster than its baud rate.
        """
        answered_ns = self._port.now_ns()
        begun_ns = answered_ns - self._port.on_wire_ns(n)
        self._beats_baud |= begun_ns < asked_ns
        if self._beats_baud:
            begun_ns = max(answered_ns, asked_ns)
        return (asked_ns + begun_ns) / 2e9, (begun_ns - asked_ns) / 2e9


def _refusal(status: str) -> str:
    return next((reason for part, reason in REFUSED_FIELDS.items() if part in status), "")


def _unusable(answers: list[str]) -> str:
    """Return why none of these answers to `?` can be used; "" without any."""
    quote = repr(answers[-1][:LONGEST_QUOTE]) if answers else ""
    quote = quote and f"the answer to '?' cannot be read: {quote}; is [stage] baud right?"
    return next(filter(None, map(_refusal, answers)), quote)


def _raise_for_event(text: str) -> None:
    """Raise TalkFault for an alarm, the banner of a restart, or a status that is refused."""
    if refusal := _refusal(text):
        raise TalkFault(refusal, position_lost=True)
    if text.startswith("ALARM:"):
        raise TalkFault(f"{explain(text, ALARM_TEXTS)}; home again", position_lost=True)
    if match := BANNER_PATTERN.search(text):
        text = f"the controller restarted ({match[0]}): its position is lost, home again"
        raise TalkFault(text, position_lost=True)


def explain(text: str, meanings: dict[int, str]) -> str:
    """Return `error:9` or `ALARM:2` with its meaning if known."""
    number, text = text.partition(":")[2], text[:LONGEST_QUOTE]
    meaning = meanings.get(int(number)) if number.isdigit() else None
    return f"{text} ({meaning})" if meaning else text


def state_text(state: str) -> str:
    """Return `Door:1 (the safety door is open)`; alarms with their meaning."""
    name, _, number = state.partition(":")
    if name == "Alarm" and number.isdigit() and int(number) in ALARM_TEXTS:
        return f"{state} ({ALARM_TEXTS[int(number)]})"
    meaning = STATE_TEXTS.get(state) or STATE_TEXTS.get(name)
    return f"{state} ({meaning})" if meaning else state
