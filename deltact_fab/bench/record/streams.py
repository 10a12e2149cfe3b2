"""Streams of a run: samples with their own times, packed losslessly, a chunk a step.

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

TIME_KEY = "t_ns"
DEFLATE_LEVEL = 1  # of deflate: higher ones take ten times as long for a hundredth of the size
FORCE_COLUMNS = ("fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm")
POSE_COLUMNS = ("x_mm", "y_mm", "z_mm")
Column = NDArray[np.int64] | NDArray[np.int32] | NDArray[np.float64] | NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Chunk:
    """Samples of one stream in one step. columns: t_ns first; per_unit: 1 where it is left out."""

    stream: str
    origin_s: float
    columns: Mapping[str, Column]
    per_unit: Mapping[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns[TIME_KEY])

    def t_press_s(self) -> NDArray[np.float64]:
        """(n,) seconds since the press began."""
        return np.asarray(self.columns[TIME_KEY] / 1e9, float)

    def values(self, name: str) -> NDArray[np.float64]:
        """(n,) of a column in its unit."""
        return np.asarray(self.columns[name] / self.per_unit.get(name, 1.0), float)


def pack(chunk: Chunk) -> dict[str, Any]:
    """The columns of a journal's row that hold a chunk: what it is, as JSON, and its bytes."""
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
    """The chunk of n samples that was packed. Raises ValueError when it is damaged."""
    try:
        raw = zlib.decompress(data)
        columns: dict[str, Column] = {}
        per_unit, offset = {}, 0
        for name, kind, unit in json.loads(heads):
            dtype = np.dtype(kind)
            part = np.frombuffer(raw, np.uint8, n * dtype.itemsize, offset)
            offset += part.size
            values = np.ascontiguousarray(part.reshape(dtype.itemsize, n).T).view(dtype)[:, 0]
            columns[name] = np.cumsum(values) if name == TIME_KEY else values
            per_unit[name] = unit
        if offset != len(raw) or TIME_KEY not in columns:
            raise ValueError("its columns do not fill it")
    except (zlib.error, TypeError, IndexError, RecursionError) as error:
        raise ValueError(str(error)) from error
    return Chunk(stream, origin_s, columns, per_unit)


def interpolate_at(
    chunk: Chunk, t_press_s: NDArray[np.float64], names: tuple[str, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Columns (m, len(names)) interpolated linearly to times (m,), and the skew (m,) in s.

    The skew is the way in time to the nearest sample. Before the first sample and after the last
    the nearest one counts.
    """
    t_s = chunk.t_press_s()
    values = [np.interp(t_press_s, t_s, chunk.values(name)) for name in names]
    k = np.searchsorted(t_s, t_press_s)
    earlier_s, later_s = t_s[np.maximum(k - 1, 0)], t_s[np.minimum(k, len(t_s) - 1)]
    skew_s = np.minimum(np.abs(t_press_s - earlier_s), np.abs(t_press_s - later_s))
    return np.stack(values, axis=1), skew_s
