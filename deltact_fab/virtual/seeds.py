"""Names of streams as numbers, for seeds; apart, for it must bring no library."""

from __future__ import annotations

import zlib


def stream_number(stream: str) -> int:
    """A number for a stream's name that is the same in every process."""
    return zlib.crc32(stream.encode())
