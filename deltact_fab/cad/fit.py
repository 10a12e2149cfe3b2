"""One pair of parts that go together, and the least and most play that their makers leave.

The worst case: every length at that limit which is worst, all at once. No statistics: a lab makes
one sensor, and that one has to go together.
"""

from __future__ import annotations

from dataclasses import dataclass

SLACK_MM = 1e-9  # sums of decimal fractions


@dataclass(frozen=True)
class Length:
    """A length as it is made: where it lies about, and what it may be off either way, in mm.

    rests_on: keys of the figures that this rests on.
    """

    mean_mm: float
    spread_mm: float = 0.0
    rests_on: tuple[str, ...] = ()

    def half(self) -> Length:
        """Half of it, with half of what it may be off."""
        return Length(self.mean_mm / 2, self.spread_mm / 2, self.rests_on)


@dataclass(frozen=True)
class PlayFit:
    """Play = what the inner lengths leave of the outer ones = sum(room) - sum(body).

    name: what goes where. parts: whose it is, by commas.
    least_mm: the play that must be left when all lengths are at their worst.
    """

    name: str
    parts: str
    room: tuple[Length, ...]
    body: tuple[Length, ...]
    least_mm: float = 0.0

    @property
    def play_mm(self) -> float:
        """Play of the lengths as they are made on average."""
        return sum(a.mean_mm for a in self.room) - sum(b.mean_mm for b in self.body)

    @property
    def spread_mm(self) -> float:
        """What it may be off either way: the sum of all."""
        return sum(length.spread_mm for length in (*self.room, *self.body))

    @property
    def range_mm(self) -> tuple[float, float]:
        """Least and most play."""
        return self.play_mm - self.spread_mm, self.play_mm + self.spread_mm

    @property
    def holds(self) -> bool:
        """Whether the least play is enough; NaN is not."""
        return self.range_mm[0] >= self.least_mm - SLACK_MM

    @property
    def rests_on(self) -> tuple[str, ...]:
        """Keys of the figures that it rests on, each once."""
        lengths = (*self.room, *self.body)
        return tuple(dict.fromkeys(key for length in lengths for key in length.rests_on))
