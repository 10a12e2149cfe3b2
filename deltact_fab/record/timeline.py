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
from collections import defaultdict
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from ..units import to_ns
from .run import Run


@dataclass(frozen=True)
class TimeLine:
    """offsets_ns: of each session; sessions: of each press and each event's seq, from 0.

    presses: all that have rows, changes of the indenter among them, in the order they were begun.
    """

    presses: tuple[str, ...]
    offsets_ns: tuple[int, ...]
    press_session: dict[str, int]
    event_session: dict[int, int]
    imported_ns: int | None = None
    """Of the first image of an imported run, whose times are the recording's own."""

    @classmethod
    def of(cls, run: Run) -> TimeLine:
        """The time line of a run. Raises RunFailed for a journal that cannot be read."""
        with run.reader() as db:
            rows = db.execute(
                "SELECT press, min(a), max(b), max(wall_s), min(wall_s - b), min(wall_s) FROM ("
                "SELECT press, t_start_s a, t_end_s b, wall_s FROM steps UNION ALL "
                "SELECT press, t_s, t_s, wall_s FROM frames) GROUP BY press ORDER BY max(wall_s)"
            ).fetchall()
            what = "SELECT seq, kind, press, t_s, wall_s FROM events ORDER BY seq"
            events = db.execute(what).fetchall()
        begun: list[float] = []  # the day's time of each session's first event
        # Of each session: from, to by its clock, and the day's time over it.
        spans: dict[int, list[tuple[float, float, float]]] = defaultdict(list)
        press_session: dict[str, int] = {}
        event_session: dict[int, int] = {}
        for seq, kind, press, t_s, wall_s in events:
            if kind == "session" or not begun:
                begun.append(wall_s)
            at = event_session[seq] = len(begun) - 1
            if press is not None:
                press_session[press] = at  # the last one: a press may be done again
            if t_s is not None:
                spans[at].append((t_s, t_s, wall_s - t_s))
        for press, first_s, last_s, wall_s, over_s, _ in rows:
            if press not in press_session:  # a change of the indenter has no event of its own
                earlier = [n for n, begun_s in enumerate(begun) if begun_s <= wall_s]
                press_session[press] = max(earlier, default=0)
            spans[press_session[press]].append((first_s, last_s, over_s))
        offsets = [0] * len(begun)  # of a session that was over before its clock ran
        end_ns = 0
        for at, span in sorted(spans.items()):
            first_s, last_s = min(first for first, _, _ in span), max(last for _, last, _ in span)
            offsets[at] = max(to_ns(span[0][2]), end_ns - to_ns(first_s))
            end_ns = offsets[at] + to_ns(last_s)
        imported_ns = None
        if run.imported and rows:
            first_s = min(row[1] for row in rows)
            # The recording's own times, moved where they would begin before 1970.
            early_s = np.nanmin([first_s, run.force()["t_s"].min(), run.pose()["t_s"].min()])
            moved_ns = to_ns(max(-float(early_s), 0.0))
            offsets, imported_ns = [moved_ns] * len(offsets), to_ns(first_s) + moved_ns
        presses = tuple(row[0] for row in sorted(rows, key=itemgetter(5)))
        return cls(presses, tuple(offsets), press_session, event_session, imported_ns)

    def of_press_ns(self, press: str, t_s: NDArray[np.float64] | float) -> NDArray[np.int64]:
        """Times of the rig's clock in a press, on the line."""
        t_ns = np.rint(np.asarray(t_s, float) * 1e9).astype(np.int64)
        return np.asarray(t_ns + self.offsets_ns[self.press_session[press]], np.int64)

    def of_event_ns(self, seq: int, t_s: float | None, wall_s: float) -> int:
        """An event's time on the line; of the day where the rig's clock did not run yet."""
        if t_s is None or math.isnan(t_s):
            return to_ns(wall_s) if self.imported_ns is None else self.imported_ns
        return to_ns(t_s) + self.offsets_ns[self.event_session[seq]]
