"""What goes wrong with a force stream, counted by name and told at most once a second."""

from __future__ import annotations

from collections import Counter

TELL_NS = 1_000_000_000  # a box that repeats every record must not fill the journal
TEXTS = {
    "gap": "{n} force samples are missing",
    "late": "{n} force samples came late, by up to {worst:.0f} ms",
    "duplicate": "{n} force records came twice",
    "order": "{n} force records came after younger ones and were left out",
    "garbage": "{n} pieces of garbage came instead of force records",
    "overrun": "{n} force records were thrown away unread: the host was too slow",
    "saturation": "{n} force samples are saturated",
    "error": "{n} force records carried the error bit: no readings",
    "behind": "{n} times the newest force sample was old when it was looked at, by up to "
    "{worst:.0f} ms",
    "silence": "no force sample came in time, {n} times",
}


class NoteCounts:
    """Counts by name, each of `TEXTS`. total: since the sensor was opened."""

    def __init__(self) -> None:
        self.total: Counter[str] = Counter()
        self._untold: Counter[str] = Counter()
        self._worst: dict[str, float] = {}
        self._told_ns: dict[str, int] = {}

    def add(self, name: str, n: int, worst: float = 0.0) -> None:
        """Something of that name happened n times; 0 is nothing."""
        if n > 0:
            self.total[name] += n
            self._untold[name] += n
            self._worst[name] = max(worst, self._worst.get(name, 0.0))

    def tell(self, now_ns: int) -> tuple[str, ...]:
        """A line "NAME: what" for each that was not told within the last second."""
        if not self._untold:
            return ()
        lines = []
        for name in [*self._untold]:
            if now_ns - self._told_ns.get(name, now_ns - TELL_NS) >= TELL_NS:
                text = TEXTS[name].format(n=self._untold.pop(name), worst=self._worst.pop(name))
                lines.append(f"{name}: {text}")
                self._told_ns[name] = now_ns
        return tuple(lines)
