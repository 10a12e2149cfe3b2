"""A simulated controller whose replies are lost, doubled or invented on their way to the host.

What the host sends arrives all the same. Nothing here changes what the board itself does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ..units import to_ns
from .controller import GrblController

Change = Callable[[bytes], bytes]


@dataclass
class _Rule:
    """Lines that begin so and are said from from_ns until until_ns, at most `most`, are changed."""

    begins: bytes
    change: Change
    from_ns: float
    until_ns: float
    most: float


class NoisyController(GrblController):
    _rules: tuple[_Rule, ...] = ()
    _invented: tuple[tuple[int, bytes], ...] = ()
    first_changed_ns = 0
    """When the first line was said that did not arrive as it was; 0: none was."""

    def change(
        self,
        change: Change,
        begins: bytes = b"",
        at_s: float = 0.0,
        for_s: float = math.inf,
        most: float = math.inf,
    ) -> None:
        """Let every line that begins so and is said in that time arrive as `change` makes it."""
        from_ns = to_ns(at_s)
        self._rules += (_Rule(begins, change, from_ns, from_ns + for_s * 1e9, most),)

    def lose(
        self,
        begins: bytes = b"",
        at_s: float = 0.0,
        for_s: float = math.inf,
        most: float = math.inf,
    ) -> None:
        """The same, and the line is lost."""
        self.change(lambda line: b"", begins, at_s, for_s, most)

    def invent(self, words: bytes, at_s: float) -> None:
        """At that time the host receives what the controller never sent."""
        self._invented = tuple(sorted((*self._invented, (to_ns(at_s), words))))

    def be_true(self) -> None:
        """From now on every word arrives as it was said."""
        self._rules, self._invented = (), ()

    def take_output(self) -> list[tuple[int, bytes]]:
        """What arrives, in order of time."""
        said = [(t_ns, self._arriving(t_ns, line)) for t_ns, line in super().take_output()]
        now_ns = self.now_ns()
        said += [(t_ns, words) for t_ns, words in self._invented if t_ns <= now_ns]
        self._invented = tuple(pair for pair in self._invented if pair[0] > now_ns)
        return sorted((pair for pair in said if pair[1]), key=lambda pair: pair[0])

    def next_event_ns(self) -> int | None:
        """Invented words reach the host at their own time, too."""
        times = [t for t in (super().next_event_ns(), *(t for t, _ in self._invented)) if t]
        return min(times, default=None)

    def _arriving(self, t_ns: int, line: bytes) -> bytes:
        for rule in self._rules:
            fits = line.strip() and line.startswith(rule.begins) and rule.most > 0
            if fits and rule.from_ns <= t_ns < rule.until_ns:
                rule.most -= 1
                self.first_changed_ns = self.first_changed_ns or t_ns
                line = rule.change(line)
        return line
