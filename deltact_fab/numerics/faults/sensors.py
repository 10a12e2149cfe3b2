"""The bench's sensors and what can go wrong with them: a force box's wire, a camera of few pixels."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...errors import SensorError
from ...rig.force.netft import COMMAND, ERROR, RECORD, SATURATED, STREAM, NetFTSettings
from ...rig.interface import Frame, Image
from ...virtual.clock import VirtualClock, to_ns
from ...virtual.netft import NetFTBox
from ...virtual.streams import stream_number

Trouble = Literal["silent", "late", "faulted", "saturated", "gap"]
LATE_S = 0.15


class BoxWire:
    """The datagrams between client and box; from a time on they are tampered with."""

    def __init__(self, box: NetFTBox, clock: VirtualClock, limit_n: float) -> None:
        """limit_n: a record beyond it is a bad one, too."""
        self.box = box
        self.first_bad_ns = 0
        """When the first record was made that told of something wrong; 0: none was."""
        self._most_counts = limit_n * box.settings().counts_per_n
        self._clock = clock
        self._start_ns = 0
        self._trouble: tuple[Trouble | None, float, float] = (None, math.inf, math.inf)
        self._held: deque[tuple[int, bytes]] = deque()  # when each is through

    def tamper(self, trouble: Trouble | None, at_s: float = 0.0, for_s: float = math.inf) -> None:
        """silent: nothing comes. late: all comes LATE_S later. faulted: the error bit, and zeros.
        saturated: its bit. gap: one record in two is lost."""
        self._trouble = (trouble, at_s * 1e9, (at_s + for_s) * 1e9)

    def settings(self) -> NetFTSettings:
        """As the box's page tells."""
        return self.box.settings()

    def send(self, command: bytes) -> None:
        """To the box."""
        if COMMAND.unpack(command)[1] == STREAM:
            self._start_ns = self._clock.now_ns()
            self._held.clear()
        self.box.send(command)

    def receive(self, timeout_s: float) -> bytes:
        """The next datagram that gets through, b"" at the time-out."""
        deadline_ns = self._clock.now_ns() + to_ns(timeout_s)
        while True:
            left_s = max(deadline_ns - self._clock.now_ns(), 0) / 1e9
            if self._held and self._held[0][0] <= self._clock.now_ns():
                return self._held.popleft()[1]
            if self._held:
                left_s = min(left_s, (self._held[0][0] - self._clock.now_ns()) / 1e9)
            data = self.box.receive(left_s)
            if data:
                self._held += self._through(data)
            elif self._clock.now_ns() >= deadline_ns:
                return b""

    def close(self) -> None:
        """Nothing more is asked for."""
        self.box.close()

    def record_ns(self, number: int) -> int:
        """When a record of the stream under way was made."""
        return self._start_ns + round(number * 1e9 / self.box.settings().rate_hz)

    def _through(self, data: bytes) -> list[tuple[int, bytes]]:
        record = np.frombuffer(data, RECORD).copy()
        made_ns = self.record_ns(int(record["rdt"][0]))
        trouble, from_ns, until_ns = self._trouble
        if trouble is None or not from_ns <= made_ns < until_ns:
            self._judge(record, made_ns)
            return [(0, data)]
        self.first_bad_ns = self.first_bad_ns or made_ns
        if trouble == "silent" or (trouble == "gap" and record["rdt"][0] % 2):
            return []
        if trouble == "late":
            return [(made_ns + to_ns(LATE_S), data)]
        if trouble == "faulted":
            record["status"], record["counts"] = ERROR, 0
        elif trouble == "saturated":
            record["status"] = SATURATED
        return [(0, record.tobytes())]

    def _judge(self, record: NDArray[np.void], made_ns: int) -> None:
        over = abs(record["counts"][0, :3]).max() > self._most_counts
        if over or record["status"][0]:
            self.first_bad_ns = self.first_bad_ns or made_ns


class PlainCamera:
    """A camera of 32 x 24 pixels: what it sees depends on the press, the frame and the tip."""

    def __init__(
        self, clock: VirtualClock, tip_mm: Callable[[], tuple[float, float, float]]
    ) -> None:
        self._clock = clock
        self._tip_mm = tip_mm
        self._stream = ""
        self._taken = 0
        self._stalled_s: tuple[float, float] = (math.inf, math.inf)
        self.first_bad_ns = 0
        """When the first frame was asked for that did not come."""

    def stall(self, at_s: float, for_s: float) -> None:
        """From that time on no image comes."""
        self._stalled_s = (at_s, at_s + for_s)

    def begin(self, stream: str) -> None:
        """Of a press: frames count anew."""
        self._stream, self._taken = stream, 0

    def capture(self) -> Frame:
        """Raises SensorError while it is stalled."""
        if self._stalled_s[0] <= self._clock.now_s() < self._stalled_s[1]:
            self.first_bad_ns = self.first_bad_ns or self._clock.now_ns()
            self._clock.sleep_s(1.0)
            raise SensorError("camera: no frame within 1 s")
        self._taken += 1
        return Frame(self._image(), self._clock.now_s(), self._taken)

    def end(self, frame_ids: Sequence[str]) -> None:
        """Nothing is kept."""

    def identity(self) -> dict[str, Any]:
        """It has no name."""
        return {"kind": "plain"}

    def close(self) -> None:
        """Nothing is open."""

    def _image(self) -> Image:
        seed = [stream_number(self._stream), self._taken]
        image = np.random.default_rng(seed).integers(0, 200, (24, 32, 3), np.uint8)
        image[0, :3, 0] = [round(200 + 20 * p) % 256 for p in self._tip_mm()]
        return image
