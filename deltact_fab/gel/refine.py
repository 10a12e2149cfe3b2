"""The way of one press solved on several meshes: its estimated error, and cells that keep to it.

A mesh COARSER times as large shows the mesh's part of the error; with friction, steps FEWER times
as large on that mesh show the steps' part. Of the force the parts are signed: cells are too stiff,
steps lose friction, and they cancel; SPREAD is what stays of either however they do. In plane they
add up. A linear level has besides what its model leaves out by the measured rule of `choose`. The
factors are to keep nine of ten smooth presses within the estimate; how many do is in
benchmarks/EVIDENCE.md, on presses that did not set them (docs/decisions/0009-gel-levels.md).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..shapes import Indenter, SkinDimensions
from .choose import IN_PLANE_MM, MOST_DOFS, TOLERANCE
from .level import Choice, GelContact, Point, State
from .material import GelMaterial
from .open import contact_of

Field = NDArray[np.float64]
Progress = Callable[[int, int, str], None]

COARSER, FEWER = 1.5, 2.0
MESH_FORCE = 1 / (COARSER**2 - 1)  # x change of force: cells are of second order
STEP_FORCE = 1 / (FEWER - 1)  # steps are of first
SPREAD = 0.9  # of either part, however they cancel
MESH_IN_PLANE, STEP_IN_PLANE = 1.9, 1.75  # x change of displacement: errors of places add up
LINEAR_FORCE, LINEAR_IN_PLANE = 0.9, 1.9  # x change with the grid of a linear level
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
class Run:
    """The way solved once. states: at rest first. flags: of the states at its corners."""

    contact: GelContact
    states: list[State]
    flags: tuple[str, ...]

    @property
    def last(self) -> State:
        """At the end of the way."""
        return self.states[-1]

    @property
    def cuts(self) -> int:
        """Of all increments."""
        return sum(s.diagnostics.cuts for s in self.states)


class Problem:
    """One way to go, on any mesh: corners (x, y, depth), the first one straight below the start."""

    def __init__(
        self,
        skin: SkinDimensions,
        material: GelMaterial,
        indenter: Indenter,
        corners: list[Point],
        tolerance: float,
        progress: Progress | None = None,
    ) -> None:
        self._tell = progress or (lambda done, total, what: None)
        self._skin, self._material, self._indenter = skin, material, indenter
        self._corners, self.tolerance = corners, tolerance
        self.in_plane_mm = IN_PLANE_MM * tolerance / TOLERANCE

    def holds(self, estimate: dict[str, float]) -> bool:
        """Whether an estimate is within the tolerance."""
        force, in_plane = estimate["force_rel"], estimate["displacement_mm"]
        return force <= self.tolerance and in_plane <= self.in_plane_mm

    def solve(self, choice: Choice, free: bool) -> tuple[Run, dict[str, float]]:
        """The finest run and its estimate; free: mesh and steps may be refined."""
        fine, by_mesh, by_step = self._three(choice)
        estimate = _sum(choice, *_shares(fine, by_mesh, by_step))
        for _ in range(REFINEMENTS if free and choice.level == "hyperelastic" else 0):
            if self.holds(estimate):
                break
            spacing, step = self._finer(*_shares(fine, by_mesh, by_step))
            spacing, step = afforded(fine, spacing, step)
            if min(spacing, step) > WORTH:
                break
            choice = choice.times(spacing, step)
            text = f"{choice.spacing_mm:.3g} mm, steps of {choice.step_mm:.3g} mm"
            choice = replace(choice, why=f"{choice.why.split('; refined')[0]}; refined to {text}")
            fine, mesh, steps = self._three(choice)
            by_mesh = _larger(mesh, by_mesh.times(spacing**2))
            by_step = _larger(steps, by_step.times(step))
            estimate = _sum(choice, *_shares(fine, by_mesh, by_step))
        return fine, estimate

    def _three(self, choice: Choice) -> tuple[Run, Change, Change]:
        """The run, and what its mesh and its steps put it off by."""
        coarse = self._run(choice.times(COARSER))
        fine = self._run(choice)
        nothing = Change(np.zeros(3), 0.0)
        if choice.level != "hyperelastic":
            return fine, _change(fine, coarse, LINEAR_FORCE, LINEAR_IN_PLANE), nothing
        by_mesh = _change(fine, coarse, MESH_FORCE, MESH_IN_PLANE)
        # Without friction a state does not depend on the way to it.
        if choice.friction == 0:
            return fine, by_mesh, nothing
        fewer = self._run(choice.times(COARSER, FEWER))
        if fewer.cuts == coarse.cuts:
            return fine, by_mesh, _change(coarse, fewer, STEP_FORCE, STEP_IN_PLANE)
        # Longer steps were cut to shorter ones, and show nothing.
        more = self._run(choice.times(COARSER, 1 / FEWER))
        return fine, by_mesh, _change(more, coarse, FEWER * STEP_FORCE, FEWER * STEP_IN_PLANE)

    def _finer(self, by_mesh: Errors, by_step: Errors) -> tuple[float, float]:
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

    def _run(self, choice: Choice) -> Run:
        contact = contact_of(self._skin, self._material, self._indenter, choice)
        x, y, _ = self._corners[0]
        states: list[State] = [contact.rest((x, y, 0.0))]
        ways = itertools.pairwise([(x, y, 0.0), *self._corners])
        total = sum(max(1, math.ceil(math.dist(a, b) / choice.step_mm - 1e-9)) for a, b in ways)
        what = f"{contact.level}, {choice.spacing_mm:.3g} mm"
        self._tell(0, total, what)
        flags: dict[str, str] = {}
        for corner in self._corners:
            for state in contact.path(states[-1], corner):
                states.append(state)
                self._tell(len(states) - 1, total, what)
            # At the corners; on the way in, the first increments are coarse by intention.
            flags.update({f.partition(":")[0]: f for f in states[-1].diagnostics.flags})
        return Run(contact, states, tuple(flags.values()))


def afforded(run: Run, spacing: float, step: float) -> tuple[float, float]:
    """As much of a refinement as MOST_DOFS and MOST_WORK leave, the mesh giving way first."""
    dofs = run.contact.dofs
    spacing = max(spacing, min(1.0, (dofs / MOST_DOFS) ** (1 / DOFS_POWER)))
    work = len(run.states) * dofs**WORK_POWER / MOST_WORK
    spacing = max(spacing, min(1.0, (work / step) ** (1 / (DOFS_POWER * WORK_POWER))))
    return spacing, max(step, min(1.0, work / spacing ** (DOFS_POWER * WORK_POWER)))


class Change(NamedTuple):
    """What one cause puts the end of the way off by: force with its sign, in plane rms."""

    force_n: Field
    in_plane_mm: float

    def times(self, factor: float) -> Change:
        """So many times as large."""
        return Change(factor * self.force_n, factor * self.in_plane_mm)


class Errors(NamedTuple):
    """A share of the estimate."""

    force_rel: float
    in_plane_mm: float


def _change(fine: Run, coarse: Run, force: float, in_plane: float) -> Change:
    """coarse - fine, times the factors; in plane rms over the lattice."""
    off = (coarse.last.displacement_mm - fine.last.displacement_mm)[..., :2]
    rms = math.sqrt(float((off**2).sum(axis=-1).mean()))
    change = np.subtract(coarse.last.force_n, fine.last.force_n)
    return Change(force * change, in_plane * rms)


def _larger(seen: Change, foreseen: Change) -> Change:
    """What a refinement shows, or what it should have left where that is more.

    A change that happens to be small ends the refinement, so that one is not to be believed.
    """
    size = np.linalg.norm
    force_n = max(seen.force_n, foreseen.force_n, key=lambda f: float(size(f)))
    return Change(force_n, max(seen.in_plane_mm, foreseen.in_plane_mm))


def _shares(run: Run, by_mesh: Change, by_step: Change) -> tuple[Errors, Errors]:
    """The estimate, parted among mesh and steps as the sizes of their own parts are."""
    mesh, steps = (float(np.linalg.norm(c.force_n)) for c in (by_mesh, by_step))
    whole = float(np.linalg.norm(by_mesh.force_n + by_step.force_n)) + SPREAD * (mesh + steps)
    size = math.hypot(*run.last.force_n) * (mesh + steps)
    each = whole / size if size else 0.0
    return Errors(each * mesh, by_mesh.in_plane_mm), Errors(each * steps, by_step.in_plane_mm)


def _sum(choice: Choice, *errors: Errors) -> dict[str, float]:
    return {
        "force_rel": choice.model_force_rel + sum(e.force_rel for e in errors),
        "displacement_mm": choice.model_in_plane_mm + sum(e.in_plane_mm for e in errors),
    }
