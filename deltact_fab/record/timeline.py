"""One time line for all that a run recorded, over its sessions: nanoseconds since 1970, UTC.

The record's stamps are of the rig's clock, which starts anew with each session. Within a session
they are kept as they are, each as far from the next as the clock had it, and moved by one offset:
that of the day's time over the rig's clock at the session's first event. A session that would
begin before the one before it ended (simulated time goes faster than the day's, and the day's
clock may be set back) is moved on to that end. So times never go back, and on a real rig they are
those of the day, as exact as its clock was when the session began.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..units import to_ns
from .run import Run


@dataclass(frozen=True)
class TimeLine:
    """offsets_ns: of each session; sessions: of each press and each event's seq, from 0."""

    offsets_ns: tuple[int, ...]
    press_session: dict[str, int]
    event_session: dict[int, int]

    @classmethod
    def of(cls, run: Run) -> TimeLine:
        """The time line of a run. Raises RunFailed for a journal that cannot be read."""
        with run.reader() as db:
            rows = db.execute(
                "SELECT press, min(a), max(b), max(wall_s), min(wall_s - b) FROM ("
                "SELECT press, t_start_s a, t_end_s b, wall_s FROM steps UNION ALL "
                "SELECT press, t_s, t_s, wall_s FROM frames) GROUP BY press ORDER BY max(wall_s)"
            ).fetchall()
            what = "SELECT seq, kind, press, t_s, wall_s FROM events ORDER BY seq"
            events = [] if run.format == 2 else db.execute(what).fetchall()
        sessions: list[_Session] = []
        press_session: dict[str, int] = {}
        event_session: dict[int, int] = {}
        for seq, kind, press, t_s, wall_s in events:
            if kind == "session" or not sessions:
                sessions.append(_Session(wall_s))
            at = event_session[seq] = len(sessions) - 1
            if press is not None:
                press_session[press] = at  # the last one: a press may be done again
            if t_s is not None:
                sessions[at].take(t_s, t_s, wall_s - t_s)
        for press, first_s, last_s, wall_s, over_s in rows:
            if run.format == 2:  # knows no sessions: each press by itself
                sessions.append(_Session(wall_s))
                press_session[press] = len(sessions) - 1
            elif press not in press_session:  # a change of the indenter has no event of its own
                begun = [n for n, session in enumerate(sessions) if session.wall_s <= wall_s]
                press_session[press] = max(begun, default=0)
            sessions[press_session[press]].take(first_s, last_s, over_s)
        offsets: list[int] = []
        end_ns = 0
        for session in sessions:
            if math.isinf(session.first_s):  # it was over before its clock ran
                offsets.append(0)
                continue
            offset_ns = max(to_ns(session.over_s), end_ns - to_ns(session.first_s))
            offsets.append(offset_ns)
            end_ns = offset_ns + to_ns(session.last_s)
        return cls(tuple(offsets), press_session, event_session)

    def of_press_ns(self, press: str, t_s: NDArray[np.float64] | float) -> NDArray[np.int64]:
        """Times of the rig's clock in a press, on the line."""
        t_ns = np.rint(np.asarray(t_s, float) * 1e9).astype(np.int64)
        return np.asarray(t_ns + self.offsets_ns[self.press_session[press]], np.int64)

    def of_event_ns(self, seq: int, t_s: float | None, wall_s: float) -> int:
        """An event's time on the line; of the day where the rig's clock did not run yet."""
        if t_s is None or math.isnan(t_s):
            return to_ns(wall_s)
        return to_ns(t_s) + self.offsets_ns[self.event_session[seq]]


@dataclass
class _Session:
    """What its clock went through, and the day's time over it at its first event."""

    wall_s: float
    first_s: float = math.inf
    last_s: float = -math.inf
    over_s: float = math.nan

    def take(self, first_s: float, last_s: float, over_s: float) -> None:
        self.first_s, self.last_s = min(self.first_s, first_s), max(self.last_s, last_s)
        if math.isnan(self.over_s):
            self.over_s = over_s
