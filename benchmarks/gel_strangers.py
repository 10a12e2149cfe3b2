"""Presses on gels that the product does not believe in, solved by `gel_twin`: truth for what it
measures. `python -m benchmarks.gel_strangers` solves them again (hours of one core) into
gel_strangers.npz; simulated, by a solver that shares no line with the product's.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common.aliases import Array

from .gel_twin import BallPress, Block, Gel, Pose, Solved, graded

FILE = Path(__file__).with_suffix(".npz")
SEED = 37
STRANGERS = {
    # Another Poisson's ratio and thickness, full stick, a base that yields, a law that stiffens.
    "P": (Gel((36.0, 34.0, 11.7), 0.56, 0.47, 0.02, 0.004), math.inf),
    "Q": (Gel((36.0, 34.0, 12.4), 0.45, 0.485, 0.05, 0.006), 0.7),
}
BALLS_MM = (12.0, 15.0, 18.0, 22.0)
EACH = 16  # presses of a stranger
DEPTHS_MM = (0.8, 1.6)  # from and to
SHEAR_MM = 0.45
LATTICE_MM = 0.75
UNIT_MM = 1e-4  # of stored displacements


@dataclass(frozen=True)
class Press:
    """A ball at a place, down to a depth, then aside: two ways, one after the other."""

    stranger: str
    ball_mm: float
    place_mm: tuple[float, float]
    depth_mm: float
    ways_rad: tuple[float, float]

    def poses(self) -> list[Pose]:
        """Down in thirds and aside in halves, all kept but the first half of the second way."""
        x, y = self.place_mm
        found = [Pose((x, y, self.depth_mm * i / 3)) for i in (1, 2, 3)]
        before = (x, y)
        for way in self.ways_rad:
            to = x + SHEAR_MM * math.cos(way), y + SHEAR_MM * math.sin(way)
            middle = (before[0] + to[0]) / 2, (before[1] + to[1]) / 2
            found.append(Pose((*middle, self.depth_mm), before == (x, y)))
            found.append(Pose((*to, self.depth_mm)))
            before = to
        return found


def presses() -> list[Press]:
    """All, drawn from SEED."""
    rng = np.random.default_rng(SEED)
    found = []
    for stranger in STRANGERS:
        for i in range(EACH):
            x, y, depth = rng.uniform([-8, -6.5, DEPTHS_MM[0]], [8, 6.5, DEPTHS_MM[1]]).tolist()
            first = rng.uniform(0, 2 * math.pi)
            ways = first, first + rng.choice([-1, 1]) * math.pi / 2
            ball = BALLS_MM[i % len(BALLS_MM)]
            found.append(Press(stranger, ball, (x, y), depth, ways))
    return found


def solved(press: Press) -> list[Solved]:
    """Its kept states."""
    gel, friction = STRANGERS[press.stranger]
    (x, y), (a, b, c) = press.place_mm, gel.size_mm
    size = 0.105 * press.ball_mm
    reach = 0.8 * math.sqrt(press.ball_mm * press.depth_mm) + SHEAR_MM
    lines = [
        graded(-a / 2, a / 2, (x - reach, x + reach), size, 1.9),
        graded(-b / 2, b / 2, (y - reach, y + reach), size, 1.9),
        graded(-c, 0.0, (-2.4, 0.0), 1.2, 1.8),
    ]
    return list(BallPress(Block(gel, lines), press.ball_mm / 2, friction).follow(press.poses()))


# Of stored displacements.
X_MM, Y_MM = (np.arange(-n, n + 1, dtype=np.float64) * LATTICE_MM for n in (23, 21))


def stored(stranger: str) -> dict[Press, dict[str, Array]]:
    """The presses of a stranger's gel. Of each state: tip_mm (3,), depth positive; force_n and
    torque_nmm (n, 3) on the gel; displacement_mm (n, ny, nx, 3) on x_mm, y_mm; points, a list of
    (m, 6): x, y, traction x, y, z in MPa and area in mm2 of what touches, on the resting face."""
    with np.load(FILE) as file:
        data = dict(file)
    ends = np.cumsum(data["count"])
    parts = np.split(data["points"].astype(float), ends[:-1])
    found = {}
    for index in np.unique(data["press"]):
        press, rows = presses()[index], np.flatnonzero(data["press"] == index)
        if press.stranger == stranger:
            found[press] = {
                **{key: data[key][rows] for key in ("tip_mm", "force_n", "torque_nmm")},
                "displacement_mm": data["moved"][rows] * UNIT_MM, "x_mm": X_MM, "y_mm": Y_MM,
                "points": [parts[row] for row in rows],
            }  # fmt: skip
    return found


def _job(index: int) -> dict[str, Any]:
    press = presses()[index]
    rows = []
    for state in solved(press):
        moved = state.face_mm(X_MM, Y_MM)
        points = np.column_stack((state.at_mm, state.traction_mpa, state.rest_mm2))
        rows.append((state.tip_mm, state.force_n, state.torque_nmm,
                     np.round(moved / UNIT_MM).astype(np.int16), points))  # fmt: skip
    return {"press": index, "rows": rows}


def main(argv: Sequence[str] | None = None) -> None:
    """Solve all, and write what there is after each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=1)
    jobs = parser.parse_args(argv).jobs
    found: dict[int, dict[str, Any]] = {}
    with get_context("spawn").Pool(jobs) as pool:
        for one in pool.imap_unordered(_job, range(len(presses()))):
            found[one["press"]] = one
            print(f"{len(found)} of {len(presses())}: {presses()[one['press']]}", flush=True)
            _write(found)


def _write(found: dict[int, dict[str, Any]]) -> None:
    rows = [(i, *row) for i in sorted(found) for row in found[i]["rows"]]
    points = [row[5] for row in rows]
    np.savez_compressed(
        FILE,
        press=np.array([row[0] for row in rows]),
        tip_mm=np.array([row[1] for row in rows]),
        force_n=np.array([row[2] for row in rows]),
        torque_nmm=np.array([row[3] for row in rows]),
        moved=np.array([row[4] for row in rows]),
        points=np.concatenate(points).astype(np.float32),
        count=np.array([len(p) for p in points]),
    )


if __name__ == "__main__":
    main()
