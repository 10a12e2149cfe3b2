"""Images from a program's standard output, as for the camera port of a Jetson."""

from __future__ import annotations

import fcntl
import struct
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ..interface import Clock
from ..program import ChildProgram
from .stream import FeedImage

STAMP_HEADER = struct.Struct("<qII")  # monotonic nanoseconds, number, unused
# By hand: a small pipe costs reads per image.
PIPE_BYTES = 1 << 20  # largest that Linux allows an ordinary process


class CommandFeed(ChildProgram):
    """Implements Feed: a program that is read image by image."""

    check = "the command and its camera"
    _unfilled: memoryview

    def __init__(
        self,
        command: Sequence[str],
        size_px: tuple[int, int],
        clock: Clock,
        folder: Path,
        stamped: bool = False,
    ) -> None:
        """folder: working directory. Raises InputError for a program that cannot be started."""
        self.name = command[0]
        self.stamps = "sender" if stamped else "arrival"
        self._command = list(command)
        self._clock = clock
        self._shape = (size_px[1], size_px[0], 3)
        self._header_bytes = STAMP_HEADER.size if stamped else 0
        super().__init__(f"camera {self.name}", "camera.command", command, folder)
        with suppress(OSError, AttributeError):  # Linux alone can enlarge it
            fcntl.fcntl(self._out.fileno(), fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        self._new_buffer()

    def next(self, timeout_s: float) -> FeedImage | None:
        """Return the next image, see Feed; a partial image is kept for the next call."""
        until_s = time.monotonic() + timeout_s
        while self._unfilled:
            left_s = until_s - time.monotonic()
            if left_s <= 0:
                return None
            self._unfilled = self._unfilled[self.receive(self._unfilled, left_s) :]
        t_s, number = self._clock.now_s(), None
        if self._header_bytes:
            t_ns, number, _ = STAMP_HEADER.unpack_from(self._bytes.data)
            t_s = t_ns / 1e9
        image = self._bytes[self._header_bytes :].reshape(self._shape)
        self._new_buffer()
        return FeedImage(image, t_s, number)

    def identity(self) -> dict[str, Any]:
        return {"kind": "command", "command": self._command}

    def _new_buffer(self) -> None:
        """Allocate the buffer of the next image; it is never reused."""
        self._bytes = np.empty(self._header_bytes + int(np.prod(self._shape)), np.uint8)
        self._unfilled = self._bytes.data
