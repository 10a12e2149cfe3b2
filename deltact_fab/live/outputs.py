"""Where results go while they come: lines for people, lines for programs, the page."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import IO

from . import picture
from .formatting import as_dict, line
from .page import LivePage
from .session import MeasuredImage, Session
from .source import Source

TERMINAL_S = 0.1
PIPED_S = 2.0
WINDOW_S = 30.0
"""Of time that the page draws of a live source; of others all that it has."""


class Output:
    """Takes results one after another."""

    def show(self, measured: MeasuredImage) -> None:
        """One more. Raises BrokenPipeError when nobody reads any longer."""

    def end(self, why: str, last: MeasuredImage | None) -> None:
        """There will be no more; last: the last one."""


@dataclass
class StatusLine(Output):
    """One line that changes on a terminal; elsewhere one every few seconds, and the last one."""

    to: IO[str]
    simulated: str | None
    next_s: float = 0.0
    written: MeasuredImage | None = None

    def show(self, measured: MeasuredImage) -> None:
        if (now_s := time.monotonic()) >= self.next_s:
            self.next_s = now_s + (TERMINAL_S if self.to.isatty() else PIPED_S)
            self._write(measured)

    def end(self, why: str, last: MeasuredImage | None) -> None:
        if last is not None:
            if last is not self.written:
                self._write(last)
            before = "\n" if self.to.isatty() else ""
            origin = f" ({self.simulated})" if self.simulated else ""
            self.to.write(f"{before}{why} after {last.given.frame + 1} images{origin}\n")
            self.to.flush()

    def _write(self, measured: MeasuredImage) -> None:
        # Back to the line's start, and what is left of a longer one erased.
        text = line(measured)
        self.to.write(f"\r{text}\x1b[K" if self.to.isatty() else f"{text}\n")
        self.to.flush()
        self.written = measured


@dataclass
class JsonLines(Output):
    """One JSON object a result, written at once."""

    to: IO[str]
    simulated: str | None

    def show(self, measured: MeasuredImage) -> None:
        told = as_dict(measured)
        if self.simulated is not None:
            told["simulated"] = self.simulated
        self.to.write(json.dumps(told, allow_nan=False) + "\n")
        self.to.flush()


@dataclass
class Summary(Output):
    """One JSON document when there are no more: how many images, and the last result."""

    to: Callable[[object], None]
    simulated: str | None

    def end(self, why: str, last: MeasuredImage | None) -> None:
        images = 0 if last is None else last.given.frame + 1
        told = None if last is None else as_dict(last)
        self.to({"ended": why, "images": images, "simulated": self.simulated, "last": told})


@dataclass
class PageOutput(Output):
    """The page, which stays open when the results end, until it is closed."""

    session: Session
    page: LivePage

    def show(self, measured: MeasuredImage) -> None:
        session = self.session
        self.page.show(
            lambda: picture.data(measured, session.view),
            lambda: picture.image(measured, session.rectified(measured.given.image)),
            picture.point(measured),
        )

    def end(self, why: str, last: MeasuredImage | None) -> None:
        self.page.ended = why


@dataclass
class HealthOutput(Output):
    """Tells the state of health that each new reference shows, where a calibration can say it."""

    tell: Callable[[str, str], None]

    def show(self, measured: MeasuredImage) -> None:
        found = measured.result.health
        if measured.result.frame == 0 and found is not None:
            self.tell(f"state of health: {found.line}", "; ".join(found.reasons))


def about(source: Source, with_force: bool) -> dict[str, object]:
    """What the page says once of a source, and of the curves that it draws."""
    if with_force:
        names, title, least = (
            ["z", "x", "y"],
            "Force on the sensor, N; a press is negative in z",
            0.2,
        )
    else:
        unit, least = ("px", 2.0) if source.known.in_px else ("mm", 0.1)
        names, title = ["largest motion"], f"Motion of the pattern, {unit}"
    return {
        "source": source.name,
        "simulated": source.known.simulated,
        "trace_names": names,
        "trace_title": title,
        "trace_least": least,
        "window_s": WINDOW_S if source.live else None,
    }
