"""Work against stored energy along a path that may jump from one equilibrium to the next."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from deltact_fab.studies.numerics.engines.gel_press import GelCase, down, energy_nmm, solve_press

INCREMENTS = 40


def work_but_jumps(scene: GelCase, depth_mm: float, scratch: Path) -> tuple[float, str]:
    """Work of a frictionless press over the increments that followed one equilibrium, less what
    the gel stored in them; or, if worse, what it stored beyond the work in one that jumped.

    In % of the energy at the end. A gel that snaps over an edge loses energy and gains none.
    """
    found = solve_press(scene, depth_mm / INCREMENTS, down(depth_mm))
    depth = np.array([s.tip_mm[2] for s in found.states])
    force = np.array([-s.force_n[2] for s in found.states])
    stored = np.array([energy_nmm(found.press, s) for s in found.states])
    left = np.diff(depth) * (force[1:] + force[:-1]) / 2 - np.diff(stored)
    jumped = np.array([s.diagnostics.damped > 0 for s in found.states[1:]])
    followed = abs(float(left[~jumped].sum())) / stored[-1]
    gained = max(0.0, -float(left[jumped].min(initial=0.0))) / stored[-1]
    lost = 100 * float(left[jumped].sum()) / stored[-1]
    note = f"{jumped.sum()} of {INCREMENTS} increments jumped, {lost:.2g} % lost; {found.note()}"
    return 100 * float(max(followed, gained)), note
