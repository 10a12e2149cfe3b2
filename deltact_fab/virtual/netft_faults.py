"""Faults of a simulated Net F/T box and its network, switched on by a test."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rig.force.netft import ERROR, SATURATED
from ..units import to_ns


class Datagram(NamedTuple):
    """One that leaves the box. at_ns: when it is there. stray: from another sender's address."""

    at_ns: int
    payload: bytes
    stray: bool = False


@dataclass
class BoxFaults:
    """Set any field at any time; the records taken from then on have it.

    every-fields: of each so many records one, 0 for none.
    """

    silent: bool = False
    """Records are taken and numbered, and none is sent."""
    late_s: float = 0.0
    """The network holds every datagram for so long; they stay in order."""
    error: bool = False
    """The error bit with zeros for readings, as a box does whose transducer is gone."""
    saturated: bool = False
    """As if a gauge were out of range."""
    drop_every: int = 0
    duplicate_every: int = 0
    swap_every: int = 0
    """Such a record comes after the next one."""
    garbage_every: int = 0
    """Before such a record comes a datagram of another length."""
    stray_every: int = 0
    """Before such a record comes a plausible one with a huge force, from another address."""
    _last_ns: int = field(default=0, repr=False)
    _held: bytes = field(default=b"", repr=False)

    def datagrams(self, t_ns: NDArray[np.int64], records: NDArray[Any]) -> list[Datagram]:
        """Records (n,) taken at t_ns as they arrive."""
        if self.error or self.saturated:
            records["status"] = ERROR | (SATURATED if self.saturated else 0)
        if self.error:
            records["counts"] = 0
        if self.silent:
            return []
        size, data = records.dtype.itemsize, records.tobytes()
        late_ns = to_ns(self.late_s)
        out = []
        for k, (at_ns, number) in enumerate(
            zip(t_ns.tolist(), records["rdt"].tolist(), strict=True)
        ):
            self._last_ns = max(at_ns + late_ns, self._last_ns)
            for payload, stray in self._as_sent(number, data[k * size : (k + 1) * size]):
                out.append(Datagram(self._last_ns, payload, stray))
        return out

    def _as_sent(self, number: int, record: bytes) -> Iterator[tuple[bytes, bool]]:
        if _one_of(number, self.garbage_every):
            yield record[:20], False
        if _one_of(number, self.stray_every):
            yield record[:12] + b"\x7f" * 24, True
        if _one_of(number, self.drop_every):
            return
        if _one_of(number, self.swap_every):
            self._held = record
            return
        yield record, False
        if _one_of(number, self.duplicate_every):
            yield record, False
        if self._held:
            held, self._held = self._held, b""
            yield held, False


def _one_of(number: int, every: int) -> bool:
    return every > 0 and number % every == 0
