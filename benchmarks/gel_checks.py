"""What a line of the gel's long tables computes: the figure that is held to a bound, and a note."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.studies.numerics.engines.gel_press import (
    GelCase,
    cone_excess,
    down,
    imbalance,
    mesh_error_percent,
    require_trusted,
    solve_press,
)


def thickness(
    scene: GelCase, step_mm: float, depth_mm: float, what: str, scratch: Path
) -> tuple[float, str]:
    """`finer` of a press, or the worse of a fall of its force and `imbalance`."""
    tip = down(depth_mm)
    if what == "force":
        return mesh_error_percent(scene, step_mm, (tip,), scratch)
    found = require_trusted(solve_press(scene, step_mm, tip))
    force = np.array([-s.force_n[2] for s in found.states])
    fall = max(0.0, -float(np.diff(force).min())) / force[-1]
    return max(fall, imbalance(found)), found.note()


def corners(scene: GelCase, at_mm: tuple[float, float], depth_mm: float, scratch: Path) -> Any:
    """Largest difference of the four corners' forces, mirrored, over the force."""
    forces, last = [], None
    for sx in (1, -1):
        for sy in (1, -1):
            x, y = sx * at_mm[0], sy * at_mm[1]
            box = (x - 4, x + 4, y - 4, y + 4)
            here = replace(scene, mirrors=(False, False), focus=box)
            last = require_trusted(solve_press(here, 1.0, (x, y, depth_mm)))
            forces.append(np.array(last.last.force_n) * [sx, sy, 1])
    assert last is not None
    spread = np.ptp(np.array(forces), axis=0).max()
    return float(spread / np.abs(forces[0]).max()), last.note()


def side_force_of_a_press(scene: GelCase, depth_mm: float, scratch: Path) -> tuple[float, str]:
    """Side force of a straight press that symmetry forbids, over the force."""
    found = require_trusted(solve_press(scene, 0.5, down(depth_mm)))
    force, _ = found.press.wrench(found.last)
    return float(np.abs(force[:2]).max() / abs(force[2])), found.note()


def long_drag(scene: GelCase, axis: int, scratch: Path) -> tuple[float, str]:
    """Worst breach of balance, cone and, where the indenter has it, mirror symmetry, 10 mm deep
    and dragged 10 mm each way."""
    found = []
    for sign in (1.0, -1.0):
        end = [0.0, 0.0, 10.0]
        end[axis] = sign * 10.0
        found.append(require_trusted(solve_press(scene, 0.5, down(10.0), (end[0], end[1], end[2]))))
    worst = max(max(imbalance(f), cone_excess(f)) for f in found)
    note = "; ".join(f.note() for f in found)
    if not (scene.indenter == "star" and axis == 0):
        a, b = (max(abs(s.force_n[axis]) for s in f.states) for f in found)
        worst = max(worst, abs(a / b - 1))
        note += f"; largest side force {a:.4g} and {b:.4g} N"
    return worst, note
