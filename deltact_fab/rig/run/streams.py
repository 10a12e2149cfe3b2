"""What stage and force sensor say while a step goes on, gathered for the record."""

from __future__ import annotations

import numpy as np

from ...record import Chunk
from ..interface import ForceSamples


class PressStreams:
    """The streams of one press. origin_ns: when it began, on the host's clock."""

    def __init__(self, origin_ns: int) -> None:
        self.origin_ns = origin_ns
        self._poses: list[tuple[int, float, float, float]] = []
        self._forces: list[ForceSamples] = []

    def t_press_s(self, t_ns: int) -> float:
        """Seconds since the press began."""
        return (t_ns - self.origin_ns) / 1e9

    def pose(self, t_ns: int, position_mm: tuple[float, float, float]) -> None:
        """Add what the stage said."""
        self._poses.append((t_ns, *position_mm))

    def force(self, samples: ForceSamples) -> None:
        """Add what the force sensor said."""
        self._forces.append(samples)

    def take(self) -> list[Chunk]:
        """All that came since the last call."""
        poses, forces = self._poses, self._forces
        self._poses, self._forces = [], []
        chunks = []
        if poses:
            t_ns = np.array([pose[0] for pose in poses], np.int64) - self.origin_ns
            x, y, z = np.array([pose[1:] for pose in poses], float).T
            columns = {"t_ns": t_ns, "x_mm": x, "y_mm": y, "z_mm": z}
            chunks.append(Chunk("pose", self.origin_ns / 1e9, columns))
        if forces:
            t_ns = np.concatenate([part.t_ns for part in forces]) - self.origin_ns
            counts = np.concatenate([part.counts for part in forces])
            names = ("fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm")
            per_unit = dict(zip(names, forces[0].per_unit.tolist(), strict=True))
            columns = {"t_ns": t_ns, **dict(zip(names, counts.T, strict=True))}
            columns["saturated"] = np.concatenate([part.saturated for part in forces])
            chunks.append(Chunk("force", self.origin_ns / 1e9, columns, per_unit))
        return chunks
