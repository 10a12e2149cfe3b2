"""A press on cells of one size, solved here and by felupe with the same law and contact."""

from __future__ import annotations

import time
from typing import Any

from deltact_fab.physics import follow_path
from deltact_fab.physics.gel.finite.press import FinitePress
from deltact_fab.sensor import GelMaterial, SkinDimensions, parse_indenter

from .felupe import solve_by_felupe

STEP_MM = 1.0
SPHERE_INDENTER = "sphere:15"


def felupe_row(depth_mm: float, spacing_mm: float) -> dict[str, Any]:
    """Forces and times of both, once after a warm-up. Raises RunFailed without felupe's answer."""

    def opened() -> FinitePress:
        skin, ball = SkinDimensions(), parse_indenter(SPHERE_INDENTER)
        gel = GelMaterial(poisson=0.49, friction=0.0)
        return FinitePress.on_block(skin, gel, ball, spacing_mm, None, (False, False), "auto")

    def solve(depth: float) -> float:
        press = opened()
        *_, last = follow_path(press, press.rest(), (0.0, 0.0, depth), STEP_MM)
        return -float(press.wrench(last)[0][2])

    solve(0.5)
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    normal_n = solve(depth_mm)
    wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
    answer = solve_by_felupe(opened(), depth_mm, STEP_MM)
    return {
        "indenter": SPHERE_INDENTER, "depth_mm": depth_mm, "spacing_mm": spacing_mm,
        "normal_n": normal_n, "wall_s": wall_s, "cpu_s": cpu_s, **answer,
        "times_as_fast": answer["felupe_s"] / wall_s,
    }  # fmt: skip
