"""The independent ray tracer is independent, and its two directions agree."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import raytraced
from benchmarks.raytraced import LAWS, Lens, Motion, true_motion_mm

LENSES = {
    "plain": Lens(),
    "decentred": Lens(law=LAWS["seventh order -"], p1=0.0012, p2=-0.0008, aspect=1.0015),
    "moving pupil": Lens(shift_mm=lambda t: 0.3 * t**2 + 0.1 * t**4),
}


def test_it_imports_nothing_of_the_product() -> None:
    tree = ast.parse((Path(raytraced.__file__)).read_text())
    names = [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    names += [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
    assert "numpy" in names
    assert not [name for name in names if name.startswith("deltact")]


@pytest.mark.parametrize("name", LENSES)
def test_ray_projects_to_its_pixel(name: str) -> None:
    lens = LENSES[name]
    px = np.random.default_rng(1).uniform((250, 60), (1030, 660), (200, 2))
    rest, slope = lens.rays(px)
    for z_mm in (0.0, -1.0, -6.0):
        points = np.concatenate((rest + slope * z_mm, np.full((200, 1), z_mm)), -1)
        assert np.abs(lens.project_px(points) - px).max() < 1e-5


def test_nearer_point_projects_further_out() -> None:
    lens, press = Lens(), Motion(press_mm=2.0, at_mm=(3.0, 0.0))
    seen = true_motion_mm(lens, press, np.array([[3.0, 0.0], [-12.0, 0.0]]))
    assert seen[0, 0] > 0.2
    assert np.abs(seen[1]).max() < 1e-3
    drag = replace(press, press_mm=0.0, drag_mm=(3.0, 0.0))
    assert true_motion_mm(lens, drag, np.array([[3.0, 0.0]])) == pytest.approx(
        np.array([[3.0, 0.0]]), abs=1e-6
    )
