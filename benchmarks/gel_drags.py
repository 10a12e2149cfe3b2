"""Drags to gross slip: the finite-strain gel against `gel_twin`, which shares no line with it.

`python -m benchmarks.gel_drags` compares with what stands in gel_drags.npz; `--solve` makes that
again (half an hour of one core). Simulated, both.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common.aliases import Array, Point
from deltact_fab.physics.gel.level import Reach, follow_path
from deltact_fab.physics.gel.level_selection import select_level
from deltact_fab.physics.gel.path.open import open_contact
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

from .gel_strangers import UNIT_MM
from .gel_twin import BallPress, Block, Gel, Pose, Solved, graded

FILE = Path(__file__).with_suffix(".npz")
LATTICE_MM = 1.0
PRESSED = 6  # steps down
LEAST_RATIO = 0.3


@dataclass(frozen=True)
class Drag:
    """A ball pressed in the middle of a standard skin of a thickness, then dragged along x."""

    ball_mm: float
    friction: float
    thickness_mm: float
    depth_mm: float
    length_mm: float
    steps: int = 12

    @property
    def name(self) -> str:
        """Of the row."""
        return (f"sphere:{self.ball_mm:g} to {self.depth_mm:g} mm, friction {self.friction:g}, "
                f"gel {self.thickness_mm:g} mm")  # fmt: skip

    @property
    def tips_mm(self) -> list[Point]:
        """(x, y, depth), down and along."""
        down = [(0.0, 0.0, self.depth_mm * i / PRESSED) for i in range(1, PRESSED + 1)]
        return down + [
            (self.length_mm * i / self.steps, 0.0, self.depth_mm) for i in range(1, self.steps + 1)
        ]

    @property
    def radius_mm(self) -> float:
        """Of the contact, about."""
        return 0.75 * math.sqrt(self.ball_mm * self.depth_mm)


DRAGS = (
    Drag(10.0, 0.3, 12.0, 1.2, 0.75),
    Drag(10.0, 1.0, 8.0, 1.0, 2.2),
    Drag(15.0, 0.5, 12.0, 1.5, 1.5),
    Drag(15.0, 0.3, 8.0, 1.2, 0.85),
    Drag(22.0, 0.5, 8.0, 1.2, 1.5),
    Drag(22.0, 1.0, 12.0, 1.5, 3.3),
)


def axes_mm() -> tuple[Array, Array]:
    """Nodes of the stored displacements: x, and y from the drag's plane on."""
    return np.arange(-17, 18) * LATTICE_MM, np.arange(17) * LATTICE_MM


def solve(drag: Drag, fineness: float = 3.2) -> dict[str, Array]:
    """The twin's. fineness: contact radius over cells."""
    gel = Gel((36.0, 34.0, drag.thickness_mm))
    a, size = drag.radius_mm, drag.radius_mm / fineness
    lines = [
        graded(-18.0, 18.0, (-1.25 * a, drag.length_mm + 1.25 * a), size, 1.5),
        graded(0.0, 17.0, (0.0, 1.3 * a), size, 1.5),
        graded(-drag.thickness_mm, 0.0, (-0.6 * a, 0.0), size, 1.6),
    ]
    press = BallPress(Block(gel, lines, mirror=True), drag.ball_mm / 2, drag.friction)
    xs, ys = axes_mm()
    found: dict[str, list[Any]] = {k: [] for k in ("tip", "force", "area", "stick", "moved")}
    for state in _as_far_as_it_goes(press.follow([Pose(tip) for tip in drag.tips_mm])):
        found["tip"].append(state.tip_mm)
        found["force"].append(state.force_n)
        for key, stuck in (("area", np.ones_like(state.slips)), ("stick", ~state.slips)):
            found[key].append(2 * state.area_mm2[stuck].sum())
        found["moved"].append(np.round(state.face_mm(xs, ys) / UNIT_MM).astype(np.int16))
    return {key: np.array(rows) for key, rows in found.items()}


@dataclass(frozen=True)
class Apart:
    """The product beside the twin along a drag, from a slip ratio of LEAST_RATIO on: largest
    errors. ratios: side force over friction x normal force, of the first and the last state
    compared. side: of the side force, relative; normal: of the normal one. in_plane_mm: rms over
    the face and largest; stick: of the stick zone's share of the contact."""

    ratios: tuple[float, float]
    side: float
    normal: float
    in_plane_mm: tuple[float, float]
    stick: float
    cpu_s: float


def compare(drag: Drag, twin: dict[str, Array], tolerance: float = 0.03) -> Apart:
    """With level, mesh and steps as `gel press` first picks them."""
    skin = SkinDimensions(thickness_mm=drag.thickness_mm)
    gel = GelMaterial(0.56, 0.49, drag.friction)
    ball, tips = parse_indenter(f"sphere:{drag.ball_mm:g}"), drag.tips_mm[: len(twin["tip"])]
    choice = select_level(skin, gel, ball, Reach.around(tips), tolerance, level="hyperelastic")
    start = time.process_time()
    contact = open_contact(skin, gel, ball, choice, LATTICE_MM)
    at = [
        np.flatnonzero(np.isclose(ours[:, None], theirs).any(1))
        for ours, theirs in zip((contact.y_mm, contact.x_mm), reversed(axes_mm()), strict=True)
    ]
    state = contact.rest((0.0, 0.0, 0.0))
    rows, ratios = [], []
    for i, tip in enumerate(tips):
        *_, state = follow_path(contact, state, tip, choice.step_mm)
        fx, _, fz = twin["force"][i]
        ratio = fx / (drag.friction * -fz)
        if tip[0] == 0 or ratio < LEAST_RATIO:
            continue
        ratios.append(float(ratio))
        off = state.displacement_mm[np.ix_(*at)][..., :2] - twin["moved"][i][..., :2] * UNIT_MM
        size = np.linalg.norm(off, axis=-1)
        zones, _ = state.zones
        stick = zones.stick_area_mm2 / zones.contact_area_mm2 - twin["stick"][i] / twin["area"][i]
        rows.append((abs(state.force_n[0] / fx - 1), abs(state.force_n[2] / fz - 1),
                     math.sqrt((size**2).mean()), size.max(), abs(stick)))  # fmt: skip
    side, normal, rms, most, stick = np.max(rows, axis=0).tolist()
    return Apart((ratios[0], ratios[-1]), side, normal, (rms, most), stick,
                 time.process_time() - start)  # fmt: skip


def _as_far_as_it_goes(states: Iterator[Solved]) -> Iterator[Solved]:
    """A long drag at friction 1 folds the gel before the ball, and the twin ends there."""
    try:
        yield from states
    except RuntimeError as why:
        print(f"ended: {why}", flush=True)


def stored() -> dict[Drag, dict[str, Array]]:
    """The twin's drags, as far as each went."""
    with np.load(FILE) as file:
        return {
            DRAGS[i]: {
                key: file[f"{key}_{i}"] for key in ("tip", "force", "area", "stick", "moved")
            }
            for i in range(len(DRAGS))
            if f"tip_{i}" in file
        }


def _keep(found: dict[int, dict[str, Array]]) -> None:
    """Beside what the file has."""
    whole = {}
    if FILE.exists():
        with np.load(FILE) as file:
            whole = dict(file)
    whole |= {f"{key}_{i}": rows for i, one in found.items() for key, rows in one.items()}
    np.savez_compressed(FILE, **whole)


def _told(index: int) -> tuple[int, dict[str, Array]]:
    start = time.process_time()
    found = solve(DRAGS[index])
    print(f"{DRAGS[index].name}: {time.process_time() - start:.0f} CPU s", flush=True)
    return index, found


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--solve", type=int, nargs="*", choices=range(len(DRAGS)), metavar="N",
                        help="solve the twin's again: those of DRAGS, or all")  # fmt: skip
    parser.add_argument("--tolerance", type=float, default=0.03)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(argv)
    if options.solve is not None:
        found = {}
        with get_context("spawn").Pool(options.jobs) as pool:
            for index, one in pool.imap_unordered(_told, options.solve or range(len(DRAGS))):
                found[index] = one
                _keep(found)
        return
    head = ("drag", "ratio", "side force, %", "normal, %", "in plane, mm rms; most",
            "stick zone, of the contact", "CPU s")  # fmt: skip
    print(f"| {' | '.join(head)} |", "|---" * len(head) + "|", sep="\n")
    for drag, twin in stored().items():
        a = compare(drag, twin, options.tolerance)
        print(f"| {drag.name} | {a.ratios[0]:.2f}-{a.ratios[1]:.2f} | {100 * a.side:.1f} | "
              f"{100 * a.normal:.1f} | {a.in_plane_mm[0]:.4f}; {a.in_plane_mm[1]:.3f} | "
              f"{a.stick:.2f} | {a.cpu_s:.0f} |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
