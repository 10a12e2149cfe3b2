"""Presses in the middle of a wide block, solved by `gel_axisymmetric` as truths for the gel.

`python -m benchmarks.gel_truths FILE --solve SEED COUNT` draws balls and flat punches, frictionless
or at full stick, and writes their forces and radial displacements (simulated, by a solver that
shares no line with the product's). The block is so wide that its shape does not matter: the truth's
is a cylinder of equal area. Without `--solve`, `gel press` is compared with a file; `--asset`
writes those of the numerics page's curves, `--map` solves those of its map (half an hour).
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

from deltact_fab.common import RunFailed
from deltact_fab.paths import asset
from deltact_fab.studies.numerics.engines.gel import (
    EXTREME_VALUES,
    RADII_STEP_MM,
    TRUTH_MPA,
    ExtremePress,
    TruePress,
    load_truths,
    wide_cells,
    wide_side_mm,
)
from deltact_fab.version import library_versions

from . import gel_drags, gel_places
from .gel_axisymmetric import Ball, Cylinder, Flat, Pressed, Tool, graded, rim_lines

EDGE_MM = 0.3  # of the product's flat punches
FINE = 0.6  # of the usual cells: at 1 thin gels were 1 % too stiff, at full stick
STICK = 2.0  # friction coefficient at which nothing slips
DRAG_ERROR = 0.02  # of the drags' forces, by finer cells: docs/evidence/gel.md
LIBRARIES = ("numpy", "scipy")


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
        return wide_side_mm(self.thickness_mm, self.contact_mm)

    def solve(self, coarsening: float = 1.0) -> Pressed:
        """Solve on cells that are so many times as large as usual."""
        face, h = self.side_mm / math.sqrt(math.pi), self.thickness_mm
        if self.kind == "ball":
            cell = coarsening * self.contact_mm / 9
            r = graded(face, cell, 1.5 * self.contact_mm, growth=1.35, most=24.0)
            tool: Tool = Ball(self.radius_mm)
            fine_mm, step_mm = self.contact_mm / 2, 0.3 * cell
        else:
            cell = coarsening * 0.08
            r = rim_lines(cell, self.radius_mm, face)
            tool, fine_mm, step_mm = Flat(self.radius_mm, EDGE_MM), 4 * cell, 0.5 * cell
        z = -graded(h, cell, min(fine_mm, h / 2), growth=1.35, most=40.0)[::-1]
        body = Cylinder(r, z, TRUTH_MPA, self.poisson)
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
    """Truth of a press; error_rel: twice the change of its force from cells 1.5 times as large."""
    row: dict[str, Any] = asdict(press) | {"side_mm": press.side_mm, "indenter": press.indenter}
    try:
        fine, coarse = press.solve(FINE), press.solve(1.5 * FINE)
    except RuntimeError as error:
        return row | {"force_n": None, "reason": str(error)}
    radii_mm = np.arange(0.0, press.side_mm / 2, RADII_STEP_MM)
    change_mm = fine.radial_mm(radii_mm) - coarse.radial_mm(radii_mm)
    return row | {
        "force_n": round(fine.force_n, 6),
        "error_rel": round(2 * abs(coarse.force_n / fine.force_n - 1), 6),
        "rim_mm": [round(r, 4) for r in fine.rim_mm],
        "in_plane_error_mm": round(float(np.sqrt((change_mm**2).mean())), 6),
        "peak_mm": round(float(np.abs(fine.u_r_mm).max()), 5),
        "radial_mm": [round(u, 5) for u in fine.radial_mm(radii_mm)],
    }


def true_press(row: dict[str, Any]) -> TruePress:
    """Truth of the numerics page."""
    return TruePress(
        row["indenter"], row["poisson"], row["friction"], (row["side_mm"],) * 2,
        row["thickness_mm"], row["depth_mm"], (0.0, 0.0, -row["force_n"]), row["error_rel"],
        "axisymmetric, benchmarks.gel_axisymmetric", radial_mm=tuple(row["radial_mm"]),
    )  # fmt: skip


def true_drag(drag: gel_drags.Drag, twin: dict[str, Any], k: int) -> TruePress:
    """Truth of the page: state k of a drag."""
    fx, fy, fz = (round(float(f), 6) for f in twin["force"][k])
    return TruePress(
        f"sphere:{drag.ball_mm:g}", 0.49, drag.friction, (36.0, 34.0), drag.thickness_mm,
        drag.depth_mm, (fx, fy, fz), DRAG_ERROR, "3D, benchmarks.gel_twin",
        round(float(twin["tip"][k][0]), 6),
    )  # fmt: skip


def write_asset(path: Path, names: Sequence[str]) -> None:
    """Write the truths of the numerics page: presses of a file by indenter, and a drag."""
    found = json.loads(path.read_text())
    rows = {row["indenter"]: row for row in found["presses"]}
    drag, twin = list(gel_drags.stored().items())[2]
    truths = [*(true_press(rows[name]) for name in names), true_drag(drag, twin, 9)]
    scripts = f"benchmarks.gel_truths {found['seed']}, benchmarks.gel_drags"
    content = {"simulated": True, "scripts": scripts, "versions": library_versions(LIBRARIES)}
    content["presses"] = [asdict(truth) for truth in truths]
    asset("gel_truths.json").write_text(json.dumps(content) + "\n")


def extreme_row(cell: ExtremePress) -> tuple[str, tuple[float, float] | None]:
    """Force and its relative error of a cell of the map; None where this solver ends too."""
    p = cell.press
    kind, _, size = p.indenter.partition(":")
    press = AxialPress("ball" if kind == "sphere" else "flat", float(size) / 2, p.poisson,
                       p.thickness_mm, p.depth_mm, p.friction)  # fmt: skip
    try:
        fine, coarse = press.solve(FINE).force_n, press.solve(1.5 * FINE).force_n
    except (RuntimeError, ArithmeticError, ValueError, IndexError) as error:
        print(f"{cell.name}: {error}", flush=True)
        return cell.name, None
    return cell.name, (round(fine, 7), round(2 * abs(coarse / fine - 1), 6))


def write_extremes(jobs: int) -> None:
    """Add the truths of the map to those of the curves."""
    with ProcessPoolExecutor(jobs) as pool:
        wide = {name: row for name, row in pool.map(extreme_row, wide_cells()) if row}
    base, drags = load_truths()[-1], {}
    for drag, twin in gel_drags.stored().items():
        if (f"sphere:{drag.ball_mm:g}", drag.thickness_mm, drag.depth_mm) != (
            base.indenter, base.thickness_mm, base.depth_mm
        ):  # fmt: skip
            continue
        lengths = EXTREME_VALUES["drag_mm"]
        for length in lengths if drag.friction in EXTREME_VALUES["friction"] else ():
            at = np.flatnonzero(np.isclose(twin["tip"][:, 0], length))
            if len(at):
                force = [round(float(f), 6) for f in twin["force"][at[0]]]
                drags[f"{drag.friction:g}, {length:g}"] = force
    path = asset("gel_truths.json")
    placed = json.loads(gel_places.FILE.read_text())["presses"][0]
    placed["indenter"] = f"sphere:{placed.pop('ball_mm'):g}"
    content = json.loads(path.read_text()) | {
        "extremes": {"wide": wide, "drags": drags}, "placed": placed
    }  # fmt: skip
    path.write_text(json.dumps(content) + "\n")


def judged_row(row: dict[str, Any]) -> dict[str, Any]:
    """Errors of `gel press` at finite strain, true and estimated; raises nothing of the gel's."""
    truth, start_s = true_press(row), time.thread_time()
    try:
        press = truth.solve(model="hyperelastic")
    except RunFailed as error:
        return row | {"refused": str(error)}
    result, cpu_s = press.result, time.thread_time() - start_s
    estimate, area_mm2 = result["error_estimate"], math.pi * float(np.mean(row["rim_mm"])) ** 2
    return row | {
        "cpu_s": cpu_s,
        "within": result["within_tolerance"],
        "force": (-result["force_n"][2] / row["force_n"] - 1, estimate["force_rel"]),
        "in_plane": (truth.in_plane_mm(press), estimate["displacement_mm"]),
        "peak": (result["peak_in_plane_mm"] - row["peak_mm"], estimate["peak_in_plane_mm"]),
        "area": (result["contact_area_mm2"] / area_mm2 - 1,
                 result["contact_area_error_mm2"] / area_mm2),
    }  # fmt: skip


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Table of errors and estimates in %, and how many are covered."""
    keys = ("force", "in_plane", "peak", "area")
    lines = [
        "| press | force | in plane, um | peak, um | area | CPU s |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        if "force" not in row:
            lines.append(f"| {row['indenter']} | {row['refused']} |")
            continue
        cells = [
            f"{scale * row[key][0]:+.2f} of {scale * row[key][1]:.2f}"
            for key, scale in zip(keys, (100, 1e3, 1e3, 100), strict=True)
        ]
        name = (f"{row['indenter']}, nu {row['poisson']:g}, {row['depth_mm']:g} of "
                f"{row['thickness_mm']:g} mm, friction {row['friction']:g}")  # fmt: skip
        lines.append(f"| {name} | {' | '.join(cells)} | {row['cpu_s']:.1f} |")
    for key in keys:
        off, estimate = np.abs([row[key] for row in rows if key in row]).T
        lines.append(
            f"{key}: {int((off <= estimate).sum())} of {len(off)} covered, rms "
            f"{math.sqrt((off**2).mean()):.4f}, median ratio {np.median(estimate / off):.1f}"
        )
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path, nargs="?")
    parser.add_argument("--solve", type=int, nargs=2, metavar=("SEED", "COUNT"))
    parser.add_argument("--asset", nargs="+", metavar="INDENTER")
    parser.add_argument("--map", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(argv)
    if options.map:
        write_extremes(options.jobs)
        return
    if options.asset:
        write_asset(options.file, options.asset)
        return
    if options.solve is None:
        rows = json.loads(options.file.read_text())["presses"]
        print(table([judged_row(row) for row in rows if row["force_n"]]))
        return
    seed, count = options.solve
    rows = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for row in pool.map(truth_row, draw(seed, count)):
            rows.append(row)
            print(
                row["indenter"], row["force_n"], row.get("error_rel"), row.get("reason"), flush=True
            )
            options.file.write_text(json.dumps({"seed": seed, "presses": rows}))


if __name__ == "__main__":
    main()
