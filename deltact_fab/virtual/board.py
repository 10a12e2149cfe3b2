"""What the virtual bench asks of a simulated controller: bytes in, bytes out, and a carriage."""

from __future__ import annotations

from typing import Protocol

from ..protocols.motion import Vec3
from .motion import Segment


class Board(Protocol):
    """No thread and no time of its own: each call first catches up with its clock."""

    def write(self, data: bytes) -> None:
        """Bytes from the host, all received now."""

    def read_available(self) -> bytes:
        """Everything said up to now and not yet read."""

    def take_output(self) -> list[tuple[int, bytes]]:
        """The same, in pieces with the time (ns) at which each was said."""

    def next_event_ns(self) -> int | None:
        """When something next happens by itself (and it may speak), None: never."""

    def now_ns(self) -> int:
        """The time of its clock."""

    def hard_reset(self) -> None:
        """The reset pin, or power off and on."""

    @property
    def segments(self) -> list[Segment]:
        """Every straight piece of the carriage's path, the planned one last."""

    def position_mm(self, t_s: float | None = None) -> Vec3:
        """Where the carriage is, machine mm, now or at a past time."""

    def path_since(self, t0_s: float) -> list[Vec3]:
        """The way of the carriage since t0, machine mm: from there, every corner, to here."""
