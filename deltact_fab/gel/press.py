"""One press, and a shear after it: level and mesh picked, the error estimated, refined if need be.

The estimate is the sum of MESH_FACTOR x the change against a mesh COARSER times as large, with
friction STEP_FACTOR x the change on that mesh with steps FEWER times as large (both again times
IN_PLANE_FACTOR for the displacement), and for a linear level what its model leaves out by the
measured rule of `choose`. The factors are such that at least nine of ten smooth presses lie within
it (docs/decisions/0009-gel-levels.md).
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import DeltactFabError, InputError
from ..shapes import Indenter, SkinDimensions
from .choose import (
    IN_PLANE_MM,
    LEAST_TOLERANCE,
    MOST_DOFS,
    MOST_TOLERANCE,
    TOLERANCE,
    Choice,
    pick,
)
from .level import GelContact, Level, Point, Reach, State, contact_of
from .material import GelMaterial

Field = NDArray[np.float64]

COARSER, MESH_FACTOR = 1.5, 1.4
FEWER, STEP_FACTOR = 2.0, 1.3
IN_PLANE_FACTOR = 1.3  # x both in plane, where errors of several places add up
REFINEMENTS = 2
FINEST = 0.45  # least factor of a refinement
# Most increments x unknowns^WORK_POWER of a refinement, about a minute on one core. Counted, not
# timed: a busy machine must not change a result.
MOST_WORK = 1.2e7
WORK_POWER = 1.3
DOFS_POWER = 2.5  # of the cells' number on their size
AIM = 0.85  # of the tolerance
MESH_SHARE = DOFS_POWER * WORK_POWER / (DOFS_POWER * WORK_POWER + 2)
WORTH = 0.9  # a refinement by less is not made


@dataclass(frozen=True, eq=False)
class Pressed:
    """The outcome. result: plain data with the keys of `gel press --json`.

    tips_mm (n, 3), forces_n (n, 3): the way, at rest first. x_mm (nx,), y_mm (ny,) and
    displacement_mm (ny, nx, 3): the face at its end. All empty when refused or not converged.
    """

    result: dict[str, Any]
    tips_mm: Field
    forces_n: Field
    x_mm: Field
    y_mm: Field
    displacement_mm: Field


@dataclass(frozen=True, eq=False)
class _Run:
    contact: GelContact
    states: list[State]
    flags: tuple[str, ...]

    @property
    def last(self) -> State:
        return self.states[-1]

    @property
    def cuts(self) -> int:
        return sum(s.diagnostics.cuts for s in self.states)


def press(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    at_mm: tuple[float, float],
    depth_mm: float,
    shear_mm: tuple[float, float] = (0.0, 0.0),
    model: Level | Literal["auto"] = "auto",
    tolerance: float = TOLERANCE,
    spacing_mm: float | None = None,
) -> Pressed:
    """Press to a depth, then shear.

    tolerance: of the force; IN_PLANE_MM in proportion goes with it. Where the estimate is over it,
    the mesh is refined, at most REFINEMENTS times and to MOST_WORK, unless spacing_mm names it.
    Raises InputError for numbers that make no press; a refusal or a failure of the solver is in
    the result, `converged` False and `force_n` None.
    """
    if not (math.isfinite(depth_mm) and depth_mm >= 0):
        raise InputError(f"--depth {depth_mm}: a depth in mm, 0 or more, is needed")
    if not all(math.isfinite(v) for v in (*at_mm, *shear_mm)):
        raise InputError(f"--at {at_mm}, shear {shear_mm}: finite mm are needed")
    if not (math.isfinite(tolerance) and LEAST_TOLERANCE <= tolerance <= MOST_TOLERANCE):
        raise InputError(
            f"--tolerance {tolerance}: {LEAST_TOLERANCE} to {MOST_TOLERANCE} of the force is needed"
        )
    started = time.perf_counter()
    x, y = at_mm
    end = (x + shear_mm[0], y + shear_mm[1], depth_mm)
    corners: list[Point] = [(x, y, depth_mm)] if end[:2] == at_mm else [(x, y, depth_mm), end]
    reach = Reach.around(corners)
    problem = _Problem(skin, material, indenter, corners, tolerance)
    picked: Choice | None = None
    try:
        picked = pick(
            skin, material, indenter, reach, tolerance, level=model, spacing_mm=spacing_mm
        )
        fine, estimate = problem.solve(picked, free=spacing_mm is None)
        if not problem.holds(estimate) and model == "auto" and picked.level != "hyperelastic":
            picked = pick(
                skin, material, indenter, reach, tolerance,
                level="hyperelastic", spacing_mm=spacing_mm,
            )  # fmt: skip
            fine, estimate = problem.solve(picked, free=spacing_mm is None)
    except DeltactFabError as why:
        level = picked.level if picked else (model if model != "auto" else None)
        return _refused(depth_mm, level, str(why), time.perf_counter() - started)
    contact, last = fine.contact, fine.last
    within = problem.holds(estimate)
    flags = list(fine.flags)
    if depth_mm > 0 and last.contact_area_mm2 == 0:
        flags.append(f"contact lost: at depth {depth_mm:g} mm nothing is touched")
    if not within:
        flags.append(
            f"tolerance: estimated error {estimate['force_rel']:.2g} of force, "
            f"{estimate['displacement_mm']:.2g} mm in plane; {tolerance:g} and "
            f"{problem.in_plane_mm:.2g} mm were asked"
        )
    u = last.displacement_mm
    choice = contact.choice
    result = {
        "force_n": list(last.force_n),
        "depth_mm": depth_mm,
        "contact_area_mm2": last.contact_area_mm2,
        "max_stretch": last.diagnostics.most_stretch,
        "model": contact.level,
        "converged": True,
        "error_estimate": estimate,
        "within_tolerance": within,
        "seconds": time.perf_counter() - started,
        "picked": {
            "spacing_mm": choice.spacing_mm,
            "step_mm": choice.step_mm,
            "mirrors": list(choice.mirrors),
            "dofs": contact.dofs,
            "why": choice.why,
        },
        "peak_in_plane_mm": float(np.hypot(u[..., 0], u[..., 1]).max()),
        "flags": flags,
    }
    return Pressed(
        result,
        np.array([s.tip_mm for s in fine.states]),
        np.array([s.force_n for s in fine.states]),
        contact.x_mm,
        contact.y_mm,
        u,
    )


class _Problem:
    """One way to go, on any mesh."""

    def __init__(
        self,
        skin: SkinDimensions,
        material: GelMaterial,
        indenter: Indenter,
        corners: list[Point],
        tolerance: float,
    ) -> None:
        self._skin, self._material, self._indenter = skin, material, indenter
        self._corners, self.tolerance = corners, tolerance
        self.in_plane_mm = IN_PLANE_MM * tolerance / TOLERANCE

    def holds(self, estimate: dict[str, float]) -> bool:
        """Whether an estimate is within the tolerance."""
        force, in_plane = estimate["force_rel"], estimate["displacement_mm"]
        return force <= self.tolerance and in_plane <= self.in_plane_mm

    def solve(self, choice: Choice, free: bool) -> tuple[_Run, dict[str, float]]:
        """The finest run and its estimate; free: mesh and steps may be refined."""
        fine, by_mesh, by_step = self._three(choice)
        estimate = _sum(choice, by_mesh, by_step)
        for _ in range(REFINEMENTS if free and choice.level == "hyperelastic" else 0):
            if self.holds(estimate):
                break
            spacing, step = self._finer(by_mesh, by_step)
            spacing, step = _afforded(fine, spacing, step)
            if min(spacing, step) > WORTH:
                break
            choice = choice.times(spacing, step)
            text = f"{choice.spacing_mm:.3g} mm, steps of {choice.step_mm:.3g} mm"
            choice = replace(choice, why=f"{choice.why.split('; refined')[0]}; refined to {text}")
            fine, by_mesh, by_step = self._three(choice)
            estimate = _sum(choice, by_mesh, by_step)
        return fine, estimate

    def _three(self, choice: Choice) -> tuple[_Run, _Errors, _Errors]:
        """The run, and what its mesh and its steps are estimated to be off by.

        Both errors may be of either sign and cancel: they are measured one by one.
        """
        coarse = self._run(choice.times(COARSER))
        fine = self._run(choice)
        by_mesh = _change(fine, coarse, MESH_FACTOR)
        # Without friction a state does not depend on the way to it.
        if choice.friction == 0 or choice.level != "hyperelastic":
            return fine, by_mesh, _Errors(0.0, 0.0)
        fewer = self._run(choice.times(COARSER, FEWER))
        if fewer.cuts == coarse.cuts:
            return fine, by_mesh, _change(coarse, fewer, STEP_FACTOR)
        # Longer steps were cut to shorter ones, and show nothing.
        more = self._run(choice.times(COARSER, 1 / FEWER))
        return fine, by_mesh, _change(more, coarse, FEWER * STEP_FACTOR)

    def _finer(self, by_mesh: _Errors, by_step: _Errors) -> tuple[float, float]:
        """Factors of cells and steps by which the estimate comes to AIM, with the least work.

        Errors go with the square of the cells and with the steps, work with powers of both: of
        equal work where the mesh's part is to the steps' as MESH_SHARE to the rest.
        """
        spacing = step = 1.0
        tolerances = (self.tolerance, self.in_plane_mm)
        for mesh, steps, tolerance in zip(by_mesh, by_step, tolerances, strict=True):
            goal = AIM * tolerance
            if mesh + steps <= tolerance:
                continue
            for_steps = min(steps, max((1 - MESH_SHARE) * goal, goal - mesh))
            for_mesh = min(mesh, goal - for_steps)
            spacing = min(spacing, math.sqrt(for_mesh / mesh) if mesh else 1.0)
            step = min(step, for_steps / steps if steps else 1.0)
        return max(spacing, FINEST), max(step, FINEST / 2)

    def _run(self, choice: Choice) -> _Run:
        contact = contact_of(self._skin, self._material, self._indenter, choice)
        x, y, _ = self._corners[0]
        states: list[State] = [contact.rest((x, y, 0.0))]
        flags: dict[str, str] = {}
        for corner in self._corners:
            for state in contact.path(states[-1], corner):
                states.append(state)
            # At the corners; on the way in, the first increments are coarse by intention.
            flags.update({f.partition(":")[0]: f for f in states[-1].diagnostics.flags})
        return _Run(contact, states, tuple(flags.values()))


def _afforded(run: _Run, spacing: float, step: float) -> tuple[float, float]:
    """As much of a refinement as MOST_DOFS and MOST_WORK leave, the mesh giving way first."""
    dofs = run.contact.dofs
    spacing = max(spacing, min(1.0, (dofs / MOST_DOFS) ** (1 / DOFS_POWER)))
    work = len(run.states) * dofs**WORK_POWER / MOST_WORK
    spacing = max(spacing, min(1.0, (work / step) ** (1 / (DOFS_POWER * WORK_POWER))))
    return spacing, max(step, min(1.0, work / spacing ** (DOFS_POWER * WORK_POWER)))


class _Errors(NamedTuple):
    force_rel: float
    in_plane_mm: float


def _change(fine: _Run, coarse: _Run, factor: float) -> _Errors:
    """factor x the change of force, and IN_PLANE_FACTOR x that of in-plane displacement, rms over
    the lattice."""
    size = math.dist(fine.last.force_n, (0.0, 0.0, 0.0))
    change = math.dist(fine.last.force_n, coarse.last.force_n)
    off = (fine.last.displacement_mm - coarse.last.displacement_mm)[..., :2]
    rms = math.sqrt(float((off**2).sum(axis=-1).mean()))
    return _Errors(factor * change / size if size else 0.0, IN_PLANE_FACTOR * factor * rms)


def _sum(choice: Choice, *errors: _Errors) -> dict[str, float]:
    return {
        "force_rel": choice.model_force_rel + sum(e.force_rel for e in errors),
        "displacement_mm": choice.model_in_plane_mm + sum(e.in_plane_mm for e in errors),
    }


def _refused(depth_mm: float, model: str | None, reason: str, seconds: float) -> Pressed:
    none = np.empty((0, 3))
    result: dict[str, Any] = {
        "force_n": None,
        "depth_mm": depth_mm,
        "contact_area_mm2": None,
        "max_stretch": None,
        "model": model,
        "converged": False,
        "error_estimate": None,
        "within_tolerance": False,
        "seconds": seconds,
        "picked": None,
        "peak_in_plane_mm": None,
        "flags": [],
        "reason": reason,
    }
    return Pressed(result, none, none, np.empty(0), np.empty(0), np.empty((0, 0, 3)))
