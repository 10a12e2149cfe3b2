"""Presses in the middle of a wide block, solved by `gel_axisymmetric` as truths for the gel.

`python -m benchmarks.gel_truths SEED COUNT` draws balls and flat punches, frictionless or at full
stick, and writes their forces and radial displacements to `ASSET` (simulated, by a solver that
shares no line with the product's). The block is so wide that its shape does not matter: the truth's
is a cylinder of equal area.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.physics.gel.press import press_gel
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

from .gel_axisymmetric import Ball, Cylinder, Flat, Pressed, graded, rim_lines

FOLDER = Path(__file__).parent
RADII_STEP_MM = 0.25
EDGE_MM = 0.3  # of the product's flat punches
STICK = 2.0  # friction coefficient at which nothing slips
MODULUS_MPA = 0.56


@dataclass(frozen=True)
class AxialPress:
    """A ball or flat punch in the middle of a square block."""

    kind: str
    radius_mm: float
    poisson: float
    thickness_mm: float
    depth_mm: float
    friction: float

    @property
    def indenter(self) -> str:
        """Name of the indenter, as `parse_indenter` reads it."""
        name = "sphere" if self.kind == "ball" else "cylinder"
        return f"{name}:{2 * self.radius_mm:g}"

    @property
    def contact_mm(self) -> float:
        return math.sqrt(self.radius_mm * self.depth_mm) if self.kind == "ball" else self.radius_mm

    @property
    def side_mm(self) -> float:
        return round(2 * (2.5 * self.thickness_mm + self.contact_mm), 1)

    def solve(self, coarsening: float = 1.0) -> Pressed:
        """Solve on cells that are so many times as large as usual."""
        face, h = self.side_mm / math.sqrt(math.pi), self.thickness_mm
        if self.kind == "ball":
            cell = coarsening * self.contact_mm / 9
            r = graded(face, cell, 1.5 * self.contact_mm, growth=1.35, most=24.0)
            tool, fine_mm, step_mm = Ball(self.radius_mm), self.contact_mm / 2, 0.3 * cell
        else:
            cell = coarsening * 0.08
            r = rim_lines(cell, self.radius_mm, face)
            tool, fine_mm, step_mm = Flat(self.radius_mm, EDGE_MM), 4 * cell, 0.5 * cell
        z = -graded(h, cell, min(fine_mm, h / 2), growth=1.35, most=40.0)[::-1]
        body = Cylinder(r, z, MODULUS_MPA, self.poisson)
        closed_mm = 1e-4 if self.friction else 1e-5
        return body.press(
            tool, [self.depth_mm], step_mm=step_mm, friction=self.friction, closed_mm=closed_mm
        )[0]


def draw(seed: int, count: int) -> list[AxialPress]:
    """Draw presses: two balls, then a flat punch; frictionless and at full stick by turns."""
    rng, presses = np.random.default_rng(seed), []
    for i in range(count):
        kind = "flat" if i % 3 == 2 else "ball"
        h = round(float(np.exp(rng.uniform(math.log(1.5), math.log(15)))), 2)
        low, high = (3.0, 14.0) if kind == "ball" else (3.0, 8.0)
        radius = round(float(rng.uniform(low, high)), 1)
        share = rng.uniform(0.04, 0.35) if kind == "ball" else rng.uniform(0.03, 0.15)
        depth = round(float(min(share * h, 0.4 * radius)), 3)
        poisson = round(float(rng.uniform(0.35, 0.495)), 3)
        presses.append(AxialPress(kind, radius, poisson, h, depth, STICK if i % 2 else 0.0))
    return presses


def truth_row(press: AxialPress) -> dict[str, Any]:
    """Truth of a press; error_rel: change of its force from cells 1.5 times as large."""
    row: dict[str, Any] = asdict(press) | {"side_mm": press.side_mm, "indenter": press.indenter}
    try:
        fine, coarse = press.solve(), press.solve(1.5)
    except RuntimeError as error:
        return row | {"force_n": None, "reason": str(error)}
    radii_mm = np.arange(0.0, press.side_mm / 2, RADII_STEP_MM)
    return row | {
        "force_n": round(fine.force_n, 6),
        "error_rel": round(abs(coarse.force_n / fine.force_n - 1), 6),
        "rim_mm": [round(r, 4) for r in fine.rim_mm],
        "peak_mm": round(float(np.abs(fine.u_r_mm).max()), 5),
        "radial_mm": [round(u, 5) for u in fine.radial_mm(radii_mm)],
    }


def judged_row(row: dict[str, Any]) -> dict[str, Any]:
    """Errors of `gel press` at finite strain, true and estimated; raises nothing of the gel's."""
    size = row["thickness_mm"]
    skin = SkinDimensions(row["side_mm"], row["side_mm"], size, min(2.0, size / 2), size)
    gel = GelMaterial(MODULUS_MPA, row["poisson"], friction=row["friction"])
    start_s = time.thread_time()
    outcome = press_gel(
        skin, gel, parse_indenter(row["indenter"]), (0.0, 0.0), row["depth_mm"],
        model="hyperelastic",
    )  # fmt: skip
    result, cpu_s = outcome.result, time.thread_time() - start_s
    if result["force_n"] is None:
        return row | {"refused": result["reason"], "cpu_s": cpu_s}
    estimate, rim_mm = result["error_estimate"], float(np.mean(row["rim_mm"]))
    x, y = np.meshgrid(outcome.x_mm, outcome.y_mm)
    r = np.hypot(x, y)
    radii_mm = RADII_STEP_MM * np.arange(len(row["radial_mm"]))
    # Nearer to the sides a block is no cylinder: nothing counts as error there.
    on = r <= row["side_mm"] / 2 - size
    radial = np.interp(r, radii_mm, row["radial_mm"]) / np.maximum(r, 1e-12)
    off = outcome.displacement_mm[..., :2] - radial[..., None] * np.stack([x, y], axis=-1)
    area_mm2 = math.pi * rim_mm**2
    return row | {
        "cpu_s": cpu_s,
        "within": result["within_tolerance"],
        "force": (-result["force_n"][2] / row["force_n"] - 1, estimate["force_rel"]),
        "in_plane": (math.sqrt((off[on] ** 2).sum() / on.size), estimate["displacement_mm"]),
        "peak": (result["peak_in_plane_mm"] - row["peak_mm"], estimate["peak_in_plane_mm"]),
        "area": (result["contact_area_mm2"] / area_mm2 - 1,
                 result["contact_area_error_mm2"] / area_mm2),
    }  # fmt: skip


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seed", type=int)
    parser.add_argument("count", type=int)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args(argv)
    rows = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for row in pool.map(truth_row, draw(options.seed, options.count)):
            rows.append(row)
            print(
                row["indenter"], row["force_n"], row.get("error_rel"), row.get("reason"), flush=True
            )
            options.out.write_text(json.dumps({"seed": options.seed, "presses": rows}))


if __name__ == "__main__":
    main()
