"""What a path's capped meshes cost: presses as `gel path` solves them, against the cells asked."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from deltact_fab.bench.rig.config import FiniteGelConfig
from deltact_fab.common.aliases import Array
from deltact_fab.physics.gel.level import Reach
from deltact_fab.physics.gel.level_selection import select_level
from deltact_fab.physics.gel.path.open import open_contact
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

CAPS = (8_000, 16_000, 32_000)  # the first is the rig file's default
REACH_MM = 10.0  # of the paper's pattern selection: depth, and drags each way
FINER_STEPS = 2  # increments of the finer solve to one of the path


def rms_mm(vectors_mm: Array) -> float:
    """Root mean square length of in-plane vectors (ny, nx, 2)."""
    return math.sqrt(float((vectors_mm**2).sum(axis=-1).mean()))


@dataclass(frozen=True)
class Held:
    """A press in the middle, then a drag along x, in increments of a rig file."""

    indenter: str
    depth_mm: float
    shear_mm: float
    press_increment_mm: float
    shear_increment_mm: float

    @property
    def name(self) -> str:
        """Of the row."""
        dragged = f", dragged {self.shear_mm:g} mm" if self.shear_mm else ""
        return f"{self.indenter} to {self.depth_mm:g} mm{dragged}"

    def tips(self, parts: int) -> list[tuple[float, float, float]]:
        """Ends of its increments, each in so many parts."""
        down = math.ceil(self.depth_mm / self.press_increment_mm - 1e-9) * parts
        along = math.ceil(self.shear_mm / self.shear_increment_mm - 1e-9) * parts
        return [
            *((0.0, 0.0, self.depth_mm * i / down) for i in range(1, down + 1)),
            *((self.shear_mm * i / along, 0.0, self.depth_mm) for i in range(1, along + 1)),
        ]


def every_held() -> list[Held]:
    """The pattern selection's mildest and a sharp indenter at its first depth, and a drag."""
    given = FiniteGelConfig()
    steps = given.press_increment_mm, given.shear_increment_mm
    straight = [Held(name, 5.0, 0.0, *steps) for name in ("edges", "ellipsoid")]
    return [*straight, Held("ellipsoid", 5.0, 2.0, *steps)]


def held_row(held: Held) -> dict[str, Any]:
    """Force and in-plane field at its end, with the mesh that each cap leaves for a whole path.

    The finer solve has the cells that the default tolerance asks for on that path, but only below
    this press and on the part that its mirrors leave, and FINER_STEPS times as many increments.
    """
    skin, material, indenter = SkinDimensions(), GelMaterial(), parse_indenter(held.indenter)

    def picked(reach: Reach, **asked: Any) -> Any:
        return select_level(skin, material, indenter, reach, level="hyperelastic", **asked)

    def solved(choice: Any, parts: int) -> Any:
        contact = open_contact(skin, material, indenter, choice)
        state = contact.rest((0.0, 0.0, 0.0))
        for tip in held.tips(parts):
            state = contact.solve(state, tip)
        return contact.dofs, np.array(state.force_n), state.displacement_mm[..., :2]

    whole = Reach((-REACH_MM, REACH_MM), (-REACH_MM, REACH_MM), REACH_MM)
    asked_mm = picked(whole).spacing_mm
    here = Reach((0.0, held.shear_mm), (0.0, 0.0), held.depth_mm)
    _, force, u = solved(picked(here, spacing_mm=asked_mm), FINER_STEPS)
    capped = []
    for most in CAPS:
        choice = picked(whole, most_unknowns=most)
        cpu = time.process_time()
        unknowns, force_n, u_mm = solved(choice, 1)
        capped.append({
            "unknowns": unknowns, "spacing_mm": choice.spacing_mm,
            "cpu_s": time.process_time() - cpu,
            "force_percent": 100 * float(np.linalg.norm(force_n - force) / np.linalg.norm(force)),
            "in_plane_mm": rms_mm(u_mm - u),
        })  # fmt: skip
    return {
        "press": held.name, "asked_mm": asked_mm, "force_n": force.tolist(),
        "largest_in_plane_mm": float(np.hypot(u[..., 0], u[..., 1]).max()), "capped": capped,
    }  # fmt: skip
