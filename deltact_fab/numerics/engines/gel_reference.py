"""What the gel's curves are held against: finite strain on two meshes, extrapolated, kept once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from ... import cache, digest
from ...aliases import Field
from .gel_finite import LATTICE_MM, GelAnswer, PressSetup, solve


@dataclass(frozen=True, eq=False)
class PunchReference:
    """The truth, and its own errors: in % of the force and in mm rms."""

    normal_n: float
    in_plane_mm: Field
    force_error: float
    in_plane_error: float


# Coarser and finer cells, steps, and steps of a second run on the coarser cells: friction remembers
# its path, and how finely that is cut is a first-order error of its own.
FINE: dict[bool, tuple[float, float, float, float | None]] = {
    True: (0.75, 0.5, 1.0, None),  # without friction
    False: (1.0, 0.75, 0.25, 0.125),
}
QUICK_FINE = (1.5, 1.0, 1.0, None)
# What `reference` says of itself, measured; a slow test holds it to that.
OWN_ERROR: dict[tuple[float, float, bool], tuple[float, float]] = {
    # (depth, friction, quick): % of the force, mm rms in plane
    (2.0, 0.0, True): (0.24, 0.0042),
    (2.0, 0.0, False): (0.17, 0.0015),
    (5.0, 0.0, False): (0.08, 0.005),
    (5.0, 0.5, False): (0.9, 0.018),
}


def reference(depth_mm: float, friction: float, quick: bool = False) -> PunchReference:
    """Extrapolated from two meshes of a quarter, and two steps; kept in the user's cache."""
    coarse, fine, step, half = QUICK_FINE if quick else FINE[friction == 0]
    made = [(coarse, step), (fine, step), *([] if half is None else [(coarse, half)])]
    runs = [PressSetup("hyperelastic", depth_mm, friction, h, step_mm=s) for h, s in made]
    key = {
        "source": digest.of("numerics.engines.gel_finite"),
        "runs": [asdict(r) for r in runs],
        "lattice": LATTICE_MM,
    }
    held = cache.get("gel-reference", key)
    if held is None:
        answers = [solve(r) for r in runs]
        held = {
            "normal_n": [a.normal_n for a in answers],
            "in_plane_mm": [a.in_plane_mm.tolist() for a in answers],
        }
        cache.put("gel-reference", key, held)
    fields = [np.array(u) for u in held["in_plane_mm"]]
    return extrapolated(held["normal_n"], fields, coarse / fine)


def extrapolated(
    normal_n: Sequence[float], in_plane_mm: Sequence[Field], ratio: float
) -> PunchReference:
    """From a coarser and a finer mesh, their cells in this ratio, and, where there is a third, the
    coarser one in half the steps. Its error: how far it lies from the finer mesh."""
    weight = 1 / (ratio**2 - 1)
    force = normal_n[1] + weight * (normal_n[1] - normal_n[0])
    u = in_plane_mm[1] + weight * (in_plane_mm[1] - in_plane_mm[0])
    if len(normal_n) > 2:
        force += 2 * (normal_n[2] - normal_n[0])
        u = u + 2 * (in_plane_mm[2] - in_plane_mm[0])
    off = rms_mm(u - in_plane_mm[1])
    return PunchReference(force, u, 100 * abs(force / normal_n[1] - 1), off)


def rms_mm(off: Field) -> float:
    """Of in-plane vectors (ny, nx, 2)."""
    return math.sqrt(float((off**2).sum(axis=-1).mean()))


def errors(answer: GelAnswer, truth: PunchReference) -> tuple[float, float]:
    """Signed, in % of the force; in mm rms."""
    force = 100 * (answer.normal_n / truth.normal_n - 1)
    return force, rms_mm(answer.in_plane_mm - truth.in_plane_mm)
