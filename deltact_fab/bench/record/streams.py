"""Streams of a run: samples with their own times, packed losslessly, one chunk per step.

A chunk holds columns of equal length. Times are whole nanoseconds since the press began, so that a
press that is done again gives the same bytes; `origin_s` puts them on the rig's clock. Values are
kept as the device gave them, with how many make up one unit. Packed: of times the differences, of
every column all first bytes of its little-endian values, then all second ones, and so on, all of it
deflated (which also guards it with a checksum).
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .folder import UnsafeFile

TIME_KEY = "t_ns"
MAX_CHUNK_BYTES = 128 << 20  # by hand: an hour of force at 1 kHz takes 119 MB
DEFLATE_LEVEL = 1  # by hand: higher levels take 10 times as long for 1 % less size
FORCE_COLUMNS = ("fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm")
POSE_COLUMNS = ("x_mm", "y_mm", "z_mm")
MONITOR_PREFIX = "monitor-"  # of a stream; then the name of the rig file's `[[monitor]]`
Column = NDArray[np.int64] | NDArray[np.int32] | NDArray[np.float64] | NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Chunk:
    """Samples of one stream in one step. columns: t_ns first; per_unit: counts per unit, else 1."""

    stream: str
    origin_s: float
    columns: Mapping[str, Column]
    per_unit: Mapping[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns[TIME_KEY])

    def t_press_s(self) -> NDArray[np.float64]:
        """Times (n,) in s since the start of the press."""
        return np.asarray(self.columns[TIME_KEY] / 1e9, float)

    def values(self, name: str) -> NDArray[np.float64]:
        """Values (n,) of a column in its unit."""
        return np.asarray(self.columns[name] / self.per_unit.get(name, 1.0), float)


def pack(chunk: Chunk) -> dict[str, Any]:
    """Pack a chunk into the columns of a journal row: description as JSON, and bytes."""
    heads, parts = [], []
    for name, column in chunk.columns.items():
        values = np.diff(column, prepend=0) if name == TIME_KEY else column
        little = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
        heads.append([name, little.dtype.str, chunk.per_unit.get(name, 1.0)])
        parts.append(little.view(np.uint8).reshape(-1, little.itemsize).T.tobytes())
    return {
        "stream": chunk.stream,
        "n": len(chunk),
        "origin_s": chunk.origin_s,
        "columns": json.dumps(heads),
        "data": zlib.compress(b"".join(parts), DEFLATE_LEVEL),
    }


def unpack(stream: str, origin_s: float, n: int, heads: str, data: bytes) -> Chunk:
    """Unpack a chunk of n samples. Raises ValueError if damaged, UnsafeFile if too large."""
    try:
        columns_read = json.loads(heads)
        kinds = [np.dtype(kind) for _, kind, _ in columns_read]
        size = n * sum(kind.itemsize for kind in kinds)
        if n < 0:
            raise ValueError(f"{n} samples")
        if size > MAX_CHUNK_BYTES:
            raise UnsafeFile(f"unpacks to {size >> 20} MiB; at most {MAX_CHUNK_BYTES >> 20} MiB")
        inflater = zlib.decompressobj()
        raw = inflater.decompress(data, size + 1)
        columns: dict[str, Column] = {}
        per_unit, offset = {}, 0
        for (name, _, unit), dtype in zip(columns_read, kinds, strict=True):
            part = np.frombuffer(raw, np.uint8, n * dtype.itemsize, offset)
            offset += part.size
            values = np.ascontiguousarray(part.reshape(dtype.itemsize, n).T).view(dtype)[:, 0]
            columns[name] = np.cumsum(values) if name == TIME_KEY else values
            per_unit[name] = unit
        if not inflater.eof or offset != len(raw) or TIME_KEY not in columns:
            raise ValueError("data length does not match its columns")
    except (zlib.error, TypeError, IndexError, RecursionError) as error:
        raise ValueError(str(error)) from error
    return Chunk(stream, origin_s, columns, per_unit)


def interpolate_at(
    chunk: Chunk, t_press_s: NDArray[np.float64], names: tuple[str, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Columns (m, len(names)) interpolated linearly to times (m,), and the skew (m,) in s.

    The skew is the time to the nearest sample. Outside the samples, the nearest one is used.
    """
    t_s = chunk.t_press_s()
    values = [np.interp(t_press_s, t_s, chunk.values(name)) for name in names]
    k = np.searchsorted(t_s, t_press_s)
    earlier_s, later_s = t_s[np.maximum(k - 1, 0)], t_s[np.minimum(k, len(t_s) - 1)]
    skew_s = np.minimum(np.abs(t_press_s - earlier_s), np.abs(t_press_s - later_s))
    return np.stack(values, axis=1), skew_s
