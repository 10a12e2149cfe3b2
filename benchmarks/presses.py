"""Random presses: the estimate of `gel press` against a reference."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from deltact_fab.physics.gel.level import Reach, follow_path
from deltact_fab.physics.gel.level_selection import select_level
from deltact_fab.physics.gel.path.open import open_contact
from deltact_fab.physics.gel.press import press_gel
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.studies.numerics.engines.gel_press import rms_mm

SEED = 23  # sets no rule of the gel; docs/evidence/gel.md tells which seeds did


def random_press(i: int) -> tuple[str, tuple[float, float], float]:
    """Indenter, place and depth of a random press of a smooth indenter, the i-th of the seed.

    From 1 mm on: what the linear level leaves out of lighter ones has a table of its own in
    docs/evidence/gel.md, and a reference of theirs takes half an hour.
    """
    rng = np.random.default_rng([SEED, i])
    if rng.random() < 0.75:
        size = round(float(rng.uniform(6.0, 22.0)), 1)
        name, half = f"sphere:{size:g}", size / 2
    else:
        size = round(float(rng.uniform(7.0, 14.0)), 1)
        name, half = f"ellipsoid:{size:g}", size / 2
    x, y = (round(float(rng.uniform(-1, 1)) * max(0.0, s - half), 1) for s in (18.0, 17.0))
    return name, (x, y), round(float(rng.uniform(1.0, 4.0)), 2)


def press_row(i: int) -> dict[str, Any]:
    """The estimate of `gel press` against the next mesh and Richardson's extrapolation."""
    name, (x, y), depth = random_press(i)
    skin, material, indenter = SkinDimensions(), GelMaterial(), parse_indenter(name)
    found = press_gel(skin, material, indenter, (x, y), depth)
    out: dict[str, Any] = {"indenter": name, "at_mm": [x, y], "depth_mm": depth}
    result = found.result
    if result["force_n"] is None:
        return {**out, "refused": result["reason"]}
    tip = (x, y, depth)
    level = result["model"]
    # A linear level is judged by finite strain, on the mesh that this would be given.
    asked = result["picked"]["spacing_mm"] if level == "hyperelastic" else None
    choice = select_level(skin, material, indenter, Reach.around([tip]), level="hyperelastic",
                  spacing_mm=asked)  # fmt: skip
    choice = replace(choice, step_mm=result["picked"]["step_mm"])

    def solved(spacing: float, step: float) -> tuple[Any, Any]:
        contact = open_contact(skin, material, indenter, choice.times(spacing, step))
        *_, last = follow_path(contact, contact.rest((x, y, 0.0)), tip, contact.choice.step_mm)
        return np.array(last.force_n), last.displacement_mm[..., :2]

    known = np.array(result["force_n"]), found.displacement_mm[..., :2]
    own = known if level == "hyperelastic" else solved(1.0, 1.0)
    # The mesh's part from the next mesh, second order; friction's from half the steps, first order.
    weight = 1 + 1 / (1.5**2 - 1)
    force, u = (
        base + weight * (finer - base) + 2 * (half - base)
        for base, finer, half in zip(own, solved(1 / 1.5, 1.0), solved(1.0, 0.5), strict=True)
    )
    true_force = float(np.linalg.norm(np.array(result["force_n"]) - force) / np.linalg.norm(force))
    true_mm = rms_mm(found.displacement_mm[..., :2] - u)
    estimate = result["error_estimate"]
    return {
        **out, "model": level, "spacing_mm": result["picked"]["spacing_mm"],
        "seconds": result["seconds"], "within_tolerance": result["within_tolerance"],
        "force": {"estimate": estimate["force_rel"], "true": true_force},
        "in_plane_mm": {"estimate": estimate["displacement_mm"], "true": true_mm},
    }  # fmt: skip
