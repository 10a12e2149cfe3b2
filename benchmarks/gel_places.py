"""Presses off the middle and near the rim, and drags, against `gel_twin`: is the estimate enough?

`python -m benchmarks.gel_places` compares `gel press` with the forces in gel_places.json and with
the drags of `gel_drags`; `--solve` makes the file again (an hour of one core). Simulated, both.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common.aliases import Point, Point2
from deltact_fab.physics.gel.press import press_gel
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

from . import gel_drags
from .gel_twin import BallPress, Block, Gel, Pose, graded

FILE = Path(__file__).with_suffix(".json")
COUNT = 6
STEPS = 4  # of a press
HALF_MM = 18.0, 17.0
SLIP_RATIO = 0.6  # side force over friction x normal force of the pose compared


@dataclass(frozen=True)
class PlacedPress:
    """A ball pressed at a place of a standard skin of a thickness."""

    ball_mm: float
    poisson: float
    thickness_mm: float
    friction: float
    place_mm: Point2
    depth_mm: float

    def solve(self) -> Point:
        """Force on the gel by the twin."""
        x, y = self.place_mm
        a = math.sqrt(self.ball_mm / 2 * self.depth_mm)
        size = a / 4.5
        lines = [
            *(graded(-half, half, (max(p - 1.3 * a, -half), min(p + 1.3 * a, half)), size, 1.6)
              for half, p in zip(HALF_MM, (x, y), strict=True)),
            graded(-self.thickness_mm, 0.0, (-0.8 * a, 0.0), 1.2 * size, 1.6),
        ]  # fmt: skip
        gel = Gel((2 * HALF_MM[0], 2 * HALF_MM[1], self.thickness_mm), poisson=self.poisson)
        press = BallPress(Block(gel, lines), self.ball_mm / 2, self.friction)
        depths = (self.depth_mm * i / STEPS for i in range(1, STEPS + 1))
        *_, last = press.follow([Pose((x, y, depth)) for depth in depths])
        fx, fy, fz = (float(f) for f in last.force_n)
        return fx, fy, fz


def draw(seed: int) -> list[PlacedPress]:
    """Draw presses: half of them with their contact within 3 mm of the rim."""
    rng, presses = np.random.default_rng(seed), []
    for i in range(COUNT):
        ball = round(float(rng.uniform(10, 20)), 1)
        h = round(float(rng.uniform(5, 12)), 1)
        depth = round(float(rng.uniform(0.08, 0.16)) * h, 2)
        a = math.sqrt(ball / 2 * depth)
        gap = rng.uniform(0.5, 3.0) if i % 2 else rng.uniform(6.0, 10.0)
        place = round(HALF_MM[0] - a - gap, 1), round(float(rng.uniform(-8, 8)), 1)
        poisson = round(float(rng.uniform(0.38, 0.49)), 3)
        presses.append(PlacedPress(ball, poisson, h, (0.0, 0.5)[i // 2 % 2], place, depth))
    return presses


def _row(press: PlacedPress) -> dict[str, Any]:
    return asdict(press) | {"force_n": press.solve()}


def _estimate(
    truth_n: Sequence[float], gel: GelMaterial, thickness_mm: float, ball_mm: float,
    place_mm: Point2, depth_mm: float, shear_mm: Point2 = (0.0, 0.0),
) -> str:  # fmt: skip
    """Line of a table: error of the force, and its estimate."""
    skin = SkinDimensions(thickness_mm=thickness_mm)
    ball = parse_indenter(f"sphere:{ball_mm:g}")
    result = press_gel(skin, gel, ball, place_mm, depth_mm, shear_mm, model="hyperelastic").result
    off = np.linalg.norm(np.array(result["force_n"]) - truth_n) / np.linalg.norm(truth_n)
    estimate = result["error_estimate"]["force_rel"]
    return f"{100 * off:.2f} | {100 * estimate:.2f} | {result['seconds']:.0f} |"


def compare() -> Iterator[str]:
    for row in json.loads(FILE.read_text())["presses"]:
        gel = GelMaterial(0.56, row["poisson"], row["friction"])
        name = (f"sphere:{row['ball_mm']:g}, nu {row['poisson']:g}, {row['thickness_mm']:g} mm, "
                f"{row['depth_mm']:g} mm at {row['place_mm']}, "
                f"friction {row['friction']:g}")  # fmt: skip
        where = row["thickness_mm"], row["ball_mm"], tuple(row["place_mm"]), row["depth_mm"]
        yield f"| {name} | {_estimate(row['force_n'], gel, *where)}"
    for drag, twin in gel_drags.stored().items():
        ratios = twin["force"][:, 0] / (drag.friction * -twin["force"][:, 2])
        k = int(np.flatnonzero((ratios >= SLIP_RATIO) & (twin["tip"][:, 0] > 0))[0])
        gel = GelMaterial(0.56, 0.49, drag.friction)
        where = drag.thickness_mm, drag.ball_mm, (0.0, 0.0), drag.depth_mm
        shear = float(twin["tip"][k][0]), 0.0
        yield f"| {drag.name}, dragged {shear[0]:.2f} mm | " + _estimate(
            twin["force"][k], gel, *where, shear
        )


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--solve", type=int, metavar="SEED", help="solve presses of a seed again")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(argv)
    if options.solve is not None:
        rows: list[dict[str, Any]] = []
        with ProcessPoolExecutor(options.jobs) as pool:
            for row in pool.map(_row, draw(options.solve)):
                rows.append(row)
                print(row, flush=True)
                FILE.write_text(json.dumps({"seed": options.solve, "presses": rows}, indent=1))
        return
    print("| press | off, % of the force | estimated, % | s |", "|---|---|---|---|", sep="\n")
    for line in compare():
        print(line, flush=True)


if __name__ == "__main__":
    main()
