"""A simulated controller as the virtual bench sees it: bytes in, bytes out, and a carriage."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

from ..aliases import Vector
from ..units import NS_PER_S, to_ns
from .carriage import Carriage
from .clock import NsClock
from .motion import Segment


class SimulatedBoard(ABC):
    """No thread and no time of its own: each call first catches up with its clock.

    settings: of the carriage, as GRBL numbers them. start_mm: where it stands at power-on, in the
    true machine frame. A firmware says what it makes of bytes (`write`) and of time (`_advance`,
    `_next_ns`); it appends what it says to `_out`, with the time in ns.
    """

    def __init__(self, settings: Mapping[int, float], clock: NsClock, start_mm: Vector) -> None:
        self._clock, self._t = clock, clock.now_ns()
        self._carriage = Carriage(settings, start_mm, self._t)
        self._out: list[tuple[int, bytes]] = []

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Bytes from the host, all received now."""

    @abstractmethod
    def hard_reset(self) -> None:
        """The reset pin (opening the port of an Arduino pulls it), or power off and on."""

    @abstractmethod
    def _advance(self) -> None:
        """Catch up with the clock: `_t` is its time afterwards."""

    @abstractmethod
    def _next_ns(self) -> int | None:
        """When something next happens by itself, None: never; `_advance` has been called."""

    # ---- the wire -----------------------------------------------------------------------------

    def read_available(self) -> bytes:
        """Everything said up to now and not yet read."""
        return b"".join(data for _, data in self.take_output())

    def take_output(self) -> list[tuple[int, bytes]]:
        """The same, in pieces with the time (ns) at which each was said."""
        self._advance()
        out, self._out = self._out, []
        return out

    def next_event_ns(self) -> int | None:
        """When something next happens by itself (and the controller may speak), None: never."""
        self._advance()
        return self._next_ns()

    def now_ns(self) -> int:
        """The time of its clock."""
        return self._clock.now_ns()

    # ---- the truth, for the scene -------------------------------------------------------------

    @property
    def segments(self) -> list[Segment]:
        """Every straight piece of the carriage's path, the planned one last."""
        self._advance()
        return self._carriage.path.segments

    def position_mm(self, t_s: float | None = None) -> Vector:
        """Where the carriage is, machine mm, now or at a past time.

        Raises ValueError for a time that has not come: what will be is not decided yet.
        """
        self._advance()
        t_ns = self._t if t_s is None else to_ns(t_s)
        if t_ns > self._t:
            raise ValueError(f"{t_s} s has not come yet: it is {self._t / NS_PER_S} s")
        return self._carriage.path.position_mm(t_ns)
