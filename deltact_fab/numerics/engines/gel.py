"""The gel at its three levels: error of force and tracked displacement against run time.

One press, a sphere of 15 mm to 2 and 5 mm in the middle of the standard skin. The reference is the
finite-strain level on two fine meshes, extrapolated at second order; what that moves the finer one
is stated as its own error. A linear level's error is its model's, whatever its grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ... import cache
from ...errors import RunFailed
from ...gel.finite.linear import Name
from ..engine import Case, Engine, Setting, Table, Work
from . import gel_cases
from .gel_run import LATTICE_MM, Answer, Field, Run, solve
from .gel_sources import FINITE, RUNS, source_hash

FORCE, IN_PLANE = "% of the force", "mm rms over the face"


@dataclass(frozen=True, eq=False)
class Reference:
    """The truth, and its own errors: in % of the force and in mm rms."""

    normal_n: float
    in_plane_mm: Field
    force_error: float
    in_plane_error: float


# -- truth -----------------------------------------------------------------------------------------

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
    (2.0, 0.0, True): (0.20, 0.0040),
    (2.0, 0.0, False): (0.17, 0.0015),
    (5.0, 0.0, False): (0.08, 0.005),
    (5.0, 0.5, False): (0.9, 0.018),
}


def reference(depth_mm: float, friction: float, quick: bool = False) -> Reference:
    """Extrapolated from two meshes of a quarter, and two steps; kept in the user's cache."""
    coarse, fine, step, half = QUICK_FINE if quick else FINE[friction == 0]
    made = [(coarse, step), (fine, step), *([] if half is None else [(coarse, half)])]
    runs = [Run("hyperelastic", depth_mm, friction, h, step_mm=s) for h, s in made]
    key = {
        "source": source_hash(*FINITE, *RUNS),
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
) -> Reference:
    """From a coarser and a finer mesh, their cells in this ratio, and, where there is a third, the
    coarser one in half the steps. Its error: how far it lies from the finer mesh."""
    weight = 1 / (ratio**2 - 1)
    force = normal_n[1] + weight * (normal_n[1] - normal_n[0])
    u = in_plane_mm[1] + weight * (in_plane_mm[1] - in_plane_mm[0])
    if len(normal_n) > 2:
        force += 2 * (normal_n[2] - normal_n[0])
        u = u + 2 * (in_plane_mm[2] - in_plane_mm[0])
    off = rms_mm(u - in_plane_mm[1])
    return Reference(force, u, 100 * abs(force / normal_n[1] - 1), off)


def rms_mm(off: Field) -> float:
    """Of in-plane vectors (ny, nx, 2)."""
    return math.sqrt(float((off**2).sum(axis=-1).mean()))


def errors(answer: Answer, truth: Reference) -> tuple[float, float]:
    """Signed, in % of the force; in mm rms."""
    force = 100 * (answer.normal_n / truth.normal_n - 1)
    return force, rms_mm(answer.in_plane_mm - truth.in_plane_mm)


# -- the engine ------------------------------------------------------------------------------------


def every_run() -> list[Run]:
    """All that `evidence` runs, once each; the longest take minutes."""
    out = []
    for depth in (2.0, 5.0):
        for mu in (0.0, 0.5):
            out += [Run("hyperelastic", depth, mu, h) for h in (3.0, 2.0, 1.5, 1.0, 0.75)]
            out += [Run("hyperelastic", depth, mu, h, "whole") for h in (3.0, 2.0, 1.5, 1.0)]
            out += [Run("auto", depth, mu, tolerance=t) for t in (0.1, 0.03, 0.01)]
        # Beyond a quarter of the thickness the linear levels refuse.
        if depth == 2.0:
            out += [Run("layer", depth, mu, h) for mu in (0.0, 0.5) for h in (0.5, 0.25, 0.125)]
            out += [Run("block", depth, mu, h) for mu in (0.0, 0.5) for h in (0.5, 0.25)]
        solvers: tuple[Name, ...] = ("pardiso", "superlu", "cg")
        out += [
            Run("hyperelastic", depth, 0.0, h, "whole", solver)
            for solver in solvers for h in (3.0, 2.0, 1.5)
        ]  # fmt: skip
        for level in ("hyperelastic", "felupe"):
            out += [Run(level, depth, 0.0, h, "even") for h in (3.0, 2.0, 1.5)]
    return out


def curves(quick: bool) -> Sequence[Setting]:
    """What can be repeated six times; the rest of `every_run` is left to `evidence`."""
    if quick:
        runs = [Run("hyperelastic", 2.0, 0.0, h) for h in (3.0, 2.0)]
        return [_setting(r, FORCE, True) for r in runs]
    out = []
    for depth in (2.0, 5.0):
        runs = [Run("hyperelastic", depth, 0.0, h) for h in (3.0, 2.0, 1.5, 1.0)]
        if depth == 2.0:
            runs += [Run("auto", depth, 0.0), Run("layer", depth, 0.0, 0.25)]
            runs += [Run("block", depth, 0.0, 0.25)]
            runs += [Run("hyperelastic", depth, 0.0, 2.0, "whole", s) for s in ("auto", "superlu")]
        units = (FORCE,) if depth == 2.0 else (FORCE, IN_PLANE)
        out += [_setting(r, unit, False) for r in runs for unit in units]
    return out


def _setting(run: Run, unit: str, quick: bool) -> Setting:
    coarse, fine, *_ = QUICK_FINE if quick else FINE[run.friction == 0]
    own = OWN_ERROR[run.depth_mm, run.friction, quick]
    return Setting(
        case=f"{run.case}: {'force' if unit == FORCE else 'in plane'}",
        series=run.series,
        name=run.name,
        unit=unit,
        reference=f"hyperelastic, quarter, {coarse:g} and {fine:g} mm extrapolated",
        reference_error=own[0] if unit == FORCE else own[1],
        build=partial(_build, run, unit, quick),
    )


def _build(run: Run, unit: str, quick: bool, scratch: Path) -> Work:
    truth = reference(run.depth_mm, run.friction, quick)
    place = 0 if unit == FORCE else 1
    return Work(partial(solve, run), lambda answer: abs(errors(answer, truth)[place]))


def cases(quick: bool) -> Sequence[Case]:
    """See `gel_cases`."""
    return gel_cases.quick_cases() if quick else gel_cases.cases()


BASELINE = Run("hyperelastic", 5.0, 0.0, 2.0, "whole", "superlu")


def tables() -> Sequence[Table]:
    """Times of one press over the baseline's, in the same process and within a minute or two."""
    import time

    truth = reference(BASELINE.depth_mm, BASELINE.friction)
    runs = [
        BASELINE,
        replace(BASELINE, solver="pardiso"),
        replace(BASELINE, solver="cg"),
        replace(BASELINE, solver="auto", part="quarter"),
        replace(BASELINE, solver="auto", part="even"),
        replace(BASELINE, solver="auto", part="even", level="felupe"),
    ]
    solve(replace(BASELINE, spacing_mm=3.0, part="quarter", solver="auto"))  # compiles
    rows: list[tuple[Any, ...]] = []
    base = math.nan
    for run in runs:
        started = time.perf_counter()
        try:
            answer = solve(run)
        except RunFailed as why:
            rows.append((run.series, run.name, None, None, None, str(why)))
            continue
        seconds = answer.inner_s or time.perf_counter() - started
        base = seconds if run == BASELINE else base
        force, in_plane = errors(answer, truth)
        rows.append(
            (run.series, run.name, round(seconds, 3), round(base / seconds, 2), round(force, 3),
             f"{in_plane:.4f} mm rms in plane, {answer.note.get('dofs')} unknowns")
        )  # fmt: skip
    return (
        Table(
            f"{BASELINE.case}: times against {BASELINE.series}, {BASELINE.name}",
            "One run each, one thread, after a warm-up, in one process. felupe: without the start "
            "of its process.",
            ("series", "cells", "seconds", "times as fast", "force error, %", "note"),
            tuple(rows),
        ),
    )


ENGINE = Engine(
    "gel",
    "Gel, three levels",
    "Linear layer, linear block and finite strain against the finest finite-strain press.",
    curves,
    cases,
    tables,
)
