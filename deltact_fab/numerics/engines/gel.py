"""The gel at its three levels: error of force and tracked displacement against run time.

One press, a sphere of 15 mm to 2 and 5 mm in the middle of the standard skin. The reference is the
finite-strain level on two fine meshes, extrapolated at second order; what that moves the finer one
is stated as its own error. A linear level's error is its model's, whatever its grid.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ...errors import MissingLibrary
from ..engine import Case, CurveSetting, Engine, EngineTable, Work
from . import gel_cases
from .gel_finite import PressSetup
from .gel_reference import FINE, OWN_ERROR, QUICK_FINE, errors, reference
from .gel_run import solve

FORCE, IN_PLANE = "% of the force", "mm rms over the face"


def curves(quick: bool) -> Sequence[CurveSetting]:
    """What can be repeated six times; the rest is left to `make evidence`."""
    if quick:
        runs = [PressSetup("hyperelastic", 2.0, 0.0, h) for h in (3.0, 2.0)]
        return [_setting(r, FORCE, True) for r in runs]
    out = []
    for depth in (2.0, 5.0):
        runs = [PressSetup("hyperelastic", depth, 0.0, h) for h in (3.0, 2.0, 1.5, 1.0)]
        if depth == 2.0:
            runs += [PressSetup("auto", depth, 0.0), PressSetup("layer", depth, 0.0, 0.25)]
            runs += [PressSetup("block", depth, 0.0, 0.25)]
            runs += [
                PressSetup("hyperelastic", depth, 0.0, 2.0, "whole", s) for s in ("auto", "superlu")
            ]
        units = (FORCE,) if depth == 2.0 else (FORCE, IN_PLANE)
        out += [_setting(r, unit, False) for r in runs for unit in units]
    return out


def _setting(run: PressSetup, unit: str, quick: bool) -> CurveSetting:
    coarse, fine, *_ = QUICK_FINE if quick else FINE[run.friction == 0]
    own = OWN_ERROR[run.depth_mm, run.friction, quick]
    return CurveSetting(
        case=f"{run.case}: {'force' if unit == FORCE else 'in plane'}",
        series=run.series,
        name=run.name,
        unit=unit,
        reference=f"hyperelastic, quarter, {coarse:g} and {fine:g} mm extrapolated",
        reference_error=own[0] if unit == FORCE else own[1],
        build=partial(_build, run, unit, quick),
    )


def _build(run: PressSetup, unit: str, quick: bool, scratch: Path) -> Work:
    truth = reference(run.depth_mm, run.friction, quick)
    place = 0 if unit == FORCE else 1
    return Work(partial(solve, run), lambda answer: abs(errors(answer, truth)[place]))


def cases(quick: bool) -> Sequence[Case]:
    """See `gel_cases`."""
    return gel_cases.quick_cases() if quick else gel_cases.cases()


BASELINE = PressSetup("hyperelastic", 5.0, 0.0, 2.0, "whole", "superlu")


def tables(scratch: Path) -> Sequence[EngineTable]:
    """Times of one press over the baseline's, in the same process and within a minute or two."""
    truth = reference(BASELINE.depth_mm, BASELINE.friction)
    runs = [
        BASELINE,
        replace(BASELINE, solver="pardiso"),
        replace(BASELINE, solver="cg"),
        replace(BASELINE, solver="auto", part="quarter"),
        replace(BASELINE, solver="auto", part="even"),
    ]
    solve(replace(BASELINE, spacing_mm=3.0, part="quarter", solver="auto"))  # compiles
    rows: list[tuple[Any, ...]] = []
    base = 0.0
    for run in runs:
        started = time.process_time()
        try:
            answer = solve(run)
        except MissingLibrary as why:  # pardiso
            rows.append((run.series, run.name, None, None, None, str(why)))
            continue
        seconds = time.process_time() - started
        base = seconds if run == BASELINE else base
        force, in_plane = errors(answer, truth)
        rows.append(
            (run.series, run.name, round(seconds, 3), round(base / seconds, 2), round(force, 3),
             f"{in_plane:.4f} mm rms in plane, {answer.note.get('dofs')} unknowns")
        )  # fmt: skip
    return (
        EngineTable(
            f"{BASELINE.case}: times against {BASELINE.series}, {BASELINE.name}",
            "One run each, one thread, after a warm-up, in one process.",
            ("series", "cells", "CPU s", "times as fast", "force error, %", "note"),
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
