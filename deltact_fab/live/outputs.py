"""Where results go while they come: lines for people, lines for programs, the page."""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import IO

from . import picture
from .formatting import as_dict, line
from .page import LivePage, PageResult
from .session import MeasuredImage, Session
from .source import Source

TERMINAL_S = 0.1
PIPED_S = 2.0
WINDOW_S = 30.0
"""Of time that the page draws of a live source; of others all that it has."""


class Output(ABC):
    """Takes results one after another."""

    @abstractmethod
    def show(self, measured: MeasuredImage) -> None:
        """One more. Raises BrokenPipeError when nobody reads any longer."""

    def end(self, why: str) -> None:  # noqa: B027 - most have nothing to say
        """There will be no more."""


class StatusLine(Output):
    """One line that changes on a terminal; elsewhere one every few seconds, and the last one."""

    def __init__(self, to: IO[str], simulated: str | None) -> None:
        self._to = to
        self._simulated = simulated
        self._live = to.isatty()
        self._next_s = 0.0
        self._last: MeasuredImage | None = None
        self._written: MeasuredImage | None = None

    def show(self, measured: MeasuredImage) -> None:
        """As Output."""
        now_s = time.monotonic()
        self._last = measured
        if now_s >= self._next_s:
            self._next_s = now_s + (TERMINAL_S if self._live else PIPED_S)
            self._write(measured)

    def end(self, why: str) -> None:
        """As Output: the last result, and why there are no more."""
        if (last := self._last) is not None:
            if last is not self._written:
                self._write(last)
            before = "\n" if self._live else ""
            origin = f" ({self._simulated})" if self._simulated else ""
            self._to.write(f"{before}{why} after {last.given.frame + 1} images{origin}\n")
            self._to.flush()

    def _write(self, measured: MeasuredImage) -> None:
        # Back to the line's start, and what is left of a longer one erased.
        text = line(measured)
        self._to.write(f"\r{text}\x1b[K" if self._live else f"{text}\n")
        self._to.flush()
        self._written = measured


class JsonLines(Output):
    """One JSON object a result, written at once."""

    def __init__(self, to: IO[str], simulated: str | None) -> None:
        self._to = to
        self._simulated = simulated

    def show(self, measured: MeasuredImage) -> None:
        """As Output."""
        told = as_dict(measured)
        if self._simulated is not None:
            told["simulated"] = self._simulated
        self._to.write(json.dumps(told, allow_nan=False) + "\n")
        self._to.flush()


class Summary(Output):
    """One JSON document when there are no more: how many images, and the last result."""

    def __init__(self, to: Callable[[object], None], simulated: str | None) -> None:
        self._to = to
        self._simulated = simulated
        self._last: MeasuredImage | None = None

    def show(self, measured: MeasuredImage) -> None:
        """As Output."""
        self._last = measured

    def end(self, why: str) -> None:
        """As Output."""
        last = self._last
        self._to(
            {
                "ended": why,
                "images": 0 if last is None else last.given.frame + 1,
                "simulated": self._simulated,
                "last": None if last is None else as_dict(last),
            }
        )


class PageOutput(Output):
    """The page, which stays open when the results end, until it is closed."""

    def __init__(self, session: Session, page: LivePage) -> None:
        self._session = session
        self._page = page

    def show(self, measured: MeasuredImage) -> None:
        """As Output; the work is done by the threads of the browsers."""
        session = self._session

        def data() -> dict[str, object]:
            return picture.data(measured, session.view)

        def image() -> picture.Array:
            return picture.image(measured, session.rectified(measured.given.image))

        self._page.show(PageResult(data, image), picture.point(measured))

    def end(self, why: str) -> None:
        """As Output."""
        self._page.end(why)


class HealthOutput(Output):
    """Tells the state of health that each new reference shows, where a calibration can say it."""

    def __init__(self, tell: Callable[[str, str], None]) -> None:
        self._tell = tell

    def show(self, measured: MeasuredImage) -> None:
        """As Output."""
        found = measured.result.health
        if measured.result.frame == 0 and found is not None:
            self._tell(f"state of health: {found.line}", "; ".join(found.reasons))


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
