"""What a line of the gel's table computes: each the figure that is held to a bound, and a note.

Each is held against something independent: a finer mesh; the work of the indenter along a
frictionless path against the energy stored; what the base carries; mirror images; the cone of
friction.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...aliases import Point
from .gel_scene import (
    GelCase,
    cone_excess,
    down,
    imbalance,
    mesh_change,
    solved,
    trusted,
    work_error,
)


def side_force(against: str, scratch: Path) -> tuple[float, str]:
    """Side force of a drag over that on a finer mesh, or in half the steps, less 1, in %."""
    scene = GelCase(
        spacing_mm=1.5, friction=0.5, focus=(-6.0, 9.0, -6.0, 6.0), mirrors=(False, True)
    )
    tips = (down(3.0), (3.0, 0.0, 3.0))
    found = trusted(solved(scene, 0.5, *tips))
    other = solved(scene.finer(), 0.5, *tips) if against == "mesh" else solved(scene, 0.25, *tips)
    return 100 * (found.last.force_n[0] / other.last.force_n[0] - 1), found.note()


def finer(scene: GelCase, step_mm: float, tips: tuple[Point, ...], scratch: Path) -> Any:
    """`mesh_change` along a path."""
    return mesh_change(scene, step_mm, *tips)


def work(scene: GelCase, depth_mm: float, scratch: Path) -> tuple[float, str]:
    """Work of a press in ten steps over the energy stored, less 1, in %."""
    found = solved(scene, depth_mm / 10, down(depth_mm))
    return 100 * work_error(found), found.note()


def scaled(factor: float, what: str, scratch: Path) -> tuple[float, str]:
    """Another modulus scales the force and nothing else: error of that, or more iterations."""
    scene = GelCase(spacing_mm=2.0, friction=0.5, mirrors=(False, True))
    tips = (down(3.0), (1.0, 0.0, 3.0))
    one, other = (solved(replace(scene, modulus_mpa=e), 1.0, *tips) for e in (0.56, 0.56 * factor))
    note = f"{one.iterations} and {other.iterations} iterations"
    if what == "iterations":
        return other.iterations - one.iterations, note
    f, g = np.array(one.last.force_n), np.array(other.last.force_n) / factor
    return float(np.abs(g - f).max() / np.abs(f).max()), note


def cone(scene: GelCase, step_mm: float, tips: tuple[Point, ...], scratch: Path) -> Any:
    """`cone_excess` at the end of a path."""
    found = trusted(solved(scene, step_mm, *tips))
    return cone_excess(found), found.note()


def balance(scene: GelCase, step_mm: float, tips: tuple[Point, ...], scratch: Path) -> Any:
    """`imbalance` along a path."""
    found = trusted(solved(scene, step_mm, *tips))
    return imbalance(found), found.note()


def stick(scratch: Path) -> tuple[float, str]:
    """Friction so high that nothing slips: ten times as high must change nothing."""
    scene = GelCase(spacing_mm=2.0, mirrors=(False, True))
    tips = (down(3.0), (1.0, 0.0, 3.0))
    a, b = (solved(replace(scene, friction=mu), 1.0, *tips) for mu in (100.0, 1000.0))
    f, g = np.array(a.last.force_n), np.array(b.last.force_n)
    return float(np.abs(f - g).max() / np.abs(f).max()), a.note()


def one_increment(scene: GelCase, depth_mm: float, scratch: Path) -> tuple[float, str]:
    """Force of a press in one step over that in ten, less 1."""
    one = solved(scene, depth_mm, down(depth_mm))
    many = solved(scene, depth_mm / 10, down(depth_mm))
    return one.normal_n / many.normal_n - 1, one.note()


def unloaded(scene: GelCase, depth_mm: float, scratch: Path) -> tuple[float, str]:
    """What is left of the displacement after a press, let go in one step."""
    found = solved(scene, 1.0, down(depth_mm))
    free = found.press.solve(found.last, down(0.0))
    return float(np.abs(free.displacement_mm).max()), found.note()


def same(one: GelCase, two: GelCase, scratch: Path) -> float:
    """Force of two scenes 3 mm deep, one over the other, less 1."""
    a, b = (solved(s, 1.0, down(3.0)) for s in (one, two))
    return a.normal_n / b.normal_n - 1


def depth_zero(scratch: Path) -> float:
    """Displacement and force of a touch."""
    press = GelCase(spacing_mm=3.0).press()
    state = press.solve(press.rest(), down(0.0))
    return float(np.abs(state.displacement_mm).max() + np.abs(state.force_n).max())


def drag_mirrored(scene: GelCase, depth_mm: float, by_mm: float, axis: int, step_mm: float) -> Any:
    """Drags to + and to - along an axis across which the indenter is symmetric: worst difference
    of the forces, mirrored, over the largest."""
    forces, notes = [], []
    for sign in (1.0, -1.0):
        tip = [0.0, 0.0, depth_mm]
        tip[axis] = sign * by_mm
        found = trusted(solved(scene, step_mm, down(depth_mm), (tip[0], tip[1], tip[2])))
        mirror = np.ones(3)
        mirror[axis] = sign
        forces.append([np.array(s.force_n) * mirror for s in found.states])
        notes.append(found.note())
    a, b = (np.array(f) for f in forces)
    return float(np.abs(a - b).max() / np.abs(a).max()), "; ".join(notes)


def drag(scene: GelCase, depth_mm: float, by_mm: float, axis: int, scratch: Path) -> Any:
    """`drag_mirrored` in steps of 0.5 mm."""
    return drag_mirrored(scene, depth_mm, by_mm, axis, 0.5)


def run(call: Callable[[], Any], scratch: Path) -> float:
    """For calls that must be refused: there is no figure."""
    call()
    return math.nan
