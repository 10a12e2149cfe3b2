"""felupe as a second opinion on a press.

felupe is GPL-3, so nothing here imports it: `make peers` puts it into `.venv-peers`, and the
script peers/felupe_press.py exchanges files. Where the environment is absent, `None` says
"not run".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common.aliases import Field
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.physics.gel.finite.press import FinitePress
from deltact_fab.physics.gel.finite.surface import HARDENING_CELLS, MAX_HARDENING, RAMP_DEPTH_SHARE
from deltact_fab.sensor.shapes.tips import SphereTip

from . import peer


@dataclass(frozen=True, eq=False)
class FelupeCase:
    """A frictionless press of a sphere on a mesh of eight-node bricks.

    nodes_mm (n, 3), cells (m, 8), faces (f, 4), base (b,): as in `physics.gel.finite.HexMesh`.
    mu_mpa, lambda_mpa, local_mpa: the law of `physics.gel.finite.material`, local its b. The
    penalty is stiffness x ramp x (1 + hardening x ramp^2), straight on from a ramp of straight_mm;
    stiffness (f,) in MPa/mm; the ramp is the penetration, rounded over width_mm (f,), at most
    shallow x depth. tips_mm (k, 3): (x, y, depth) in turn. tolerance: of unbalanced over contact
    forces, these taken as floor_n at least. most_iterations: before felupe's increment is halved.
    """

    nodes_mm: Field
    cells: NDArray[np.int64]
    faces: NDArray[np.int64]
    base: NDArray[np.int64]
    mu_mpa: float
    lambda_mpa: float
    local_mpa: float
    radius_mm: float
    stiffness: Field
    hardening_per_mm2: Field
    straight_mm: Field
    width_mm: Field
    shallow: float
    tips_mm: Field
    tolerance: float
    floor_n: float
    most_iterations: int = 16


def felupe_case(press: FinitePress, tips_mm: Sequence[tuple[float, float, float]]) -> FelupeCase:
    """What `press` solves, for felupe: the same mesh, law, penalty, rounding and tolerance.

    Raises InputError for friction, for indenters other than one sphere and for other than 2 x 2
    contact points a face, which the script lacks.
    """
    tips = press.indenter.tips
    if len(tips) != 1 or not isinstance(tips[0], SphereTip) or press.friction > 0:
        raise InputError(
            f"felupe: a sphere without friction is needed, {press.indenter.name} with friction "
            f"{press.friction:g} was given"
        )
    mesh, surface = press.mesh, press.surface
    if surface.weights_mm2.shape[1] != 4:
        raise InputError("felupe: 2 x 2 contact points a face are needed: points = 2")
    if int((~press.pattern.free).sum()) != 3 * len(mesh.base):
        raise InputError("felupe: a mesh without planes of symmetry is needed")
    doubled = HARDENING_CELLS * np.sqrt(surface.weights_mm2.sum(axis=1))
    return FelupeCase(
        mesh.nodes_mm, mesh.cells, mesh.faces, mesh.base, press.law.mu_mpa, press.law.lambda_mpa,
        press.law.local_mpa, tips[0].radius_mm, surface.stiffness[:, 0], 1 / doubled**2,
        MAX_HARDENING * doubled, surface.width_mm[:, 0], RAMP_DEPTH_SHARE,
        np.array(tips_mm, dtype=np.float64), press.tolerance, press.floor_n,
    )  # fmt: skip


def felupe_press(
    case: FelupeCase, threads: int = 1, timeout_s: float = 3600.0
) -> dict[str, Any] | None:
    """felupe's answer, or None ("not run") where there is no environment of peers.

    force_n (k, 3) on the indented face's sensor, displacement_mm (k, s, 3) of the nodes `surface`
    (s,), iterations (k,), seconds (k,), all only up to where it converged; converged, reason,
    threads, unknowns, setup_s, press_s, solver_s, felupe (its version). Raises RunFailed when the
    script itself breaks or takes longer than timeout_s.
    """
    given = {k: getattr(case, k) for k in case.__dataclass_fields__}
    return peer.ask("felupe", "felupe_press.py", given, threads, timeout_s)


def solve_by_felupe(press: FinitePress, depth_mm: float, step_mm: float) -> dict[str, Any]:
    """A press in the middle. Raises RunFailed without felupe, or where it does not converge."""
    n = max(1, math.ceil(depth_mm / step_mm - 1e-9))
    tips = [(0.0, 0.0, depth_mm * (i / n)) for i in range(1, n + 1)]
    found = felupe_press(felupe_case(press, tips))
    if found is None:
        raise RunFailed("felupe: not run: no .venv-peers (make peers)")
    if not found["converged"]:
        raise RunFailed(f"felupe: {found['reason']}")
    return {
        "felupe_n": -float(found["force_n"][-1][2]),
        "felupe_s": float(found["setup_s"] + found["press_s"]),
        "unknowns": found["unknowns"],
        "felupe": found["felupe"],
    }
