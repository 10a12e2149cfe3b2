"""One gel, several levels of mechanics behind one interface; `open.open_contact` makes one.

layer: linear, bonded, no sides. block: linear with free sides. hyperelastic: finite strain, free
sides (`finite`). `levels` finds the linear ones. All press an `Indenter`, keep their history in the
state and show the face on one and the same lattice, whatever they compute on.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ..aliases import Field, Point

Level = str
"""A name of `levels.LEVELS`."""


@dataclass(frozen=True)
class Reach:
    """Where a path's tip goes: x_mm and y_mm (low, high) on the face, deepest_mm into the gel.

    Raises ValueError for numbers that are not finite or out of order.
    """

    x_mm: tuple[float, float] = (0.0, 0.0)
    y_mm: tuple[float, float] = (0.0, 0.0)
    deepest_mm: float = 0.0

    def __post_init__(self) -> None:
        for name, pair in (("x_mm", self.x_mm), ("y_mm", self.y_mm)):
            if not (all(math.isfinite(v) for v in pair) and pair[0] <= pair[1]):
                raise ValueError(f"reach: {name} (low, high), finite: {pair} fails")
        if not math.isfinite(self.deepest_mm):
            raise ValueError(f"reach: a finite depth is needed: {self.deepest_mm} fails")

    @classmethod
    def around(cls, tips_mm: Iterable[Point]) -> Reach:
        """The smallest that holds tips (x, y, depth), at least one."""
        x, y, depth = np.array(list(tips_mm), dtype=np.float64).T
        return cls(
            (float(x.min()), float(x.max())), (float(y.min()), float(y.max())), float(depth.max())
        )


@dataclass(frozen=True)
class Choice:
    """What `level_selection.pick` picked.

    spacing_mm: of the linear grid, or of cells at the contact. step_mm: of a path's increments.
    mirrors: planes x = 0, y = 0 at which the mesh ends. focus: box of fine cells
    (x_low, x_high, y_low, y_high). friction: as it is solved, 0 where it was left out.
    model_force_rel, model_in_plane_mm: what the level itself leaves out, by the measured rule; 0
    for the finest level. why: one line for a reader. asked_mm: the cells that the tolerance asks
    for, smaller than spacing_mm where most_unknowns does not afford them; 0: not chosen so.
    growth: of cells away from the focus, from one to the next; 1: of a linear grid.
    """

    level: Level
    spacing_mm: float
    step_mm: float
    mirrors: tuple[bool, bool]
    focus: tuple[float, float, float, float]
    friction: float
    model_force_rel: float
    model_in_plane_mm: float
    why: str
    asked_mm: float = 0.0
    growth: float = 1.0

    def times(self, spacing: float = 1.0, step: float = 1.0) -> Choice:
        """The same with cells or grid, and steps, larger by these factors.

        So many cells become one, those that grow too: with one growth for all meshes the cells away
        from the contact were alike, and a comparison did not show what they cost.
        """
        return replace(
            self,
            spacing_mm=self.spacing_mm * spacing,
            step_mm=self.step_mm * step,
            growth=self.growth**spacing,
        )


@dataclass(frozen=True)
class IncrementDiagnostics:
    """Work and quality of the increment that led to a state.

    iterations: Newton's, or operator applications of a linear level. cuts: halvings of the
    increment. residual: of forces over the contact's, or of the contact conditions over the depth.
    least_j: smallest volume ratio, or det(I + grad u_xy) of a linear level's face.
    most_stretch: None for a linear level. flags: what a reader must not miss, `NAME: sentence`.
    """

    iterations: int = 0
    cuts: int = 0
    residual: float = 0.0
    penetration_mm: float = 0.0
    least_j: float = 1.0
    most_stretch: float | None = None
    flags: tuple[str, ...] = ()


class State(Protocol):
    """A solved position; also the history that the next one needs. Fields are on the lattice.

    force_n, torque_nmm: on the sensor, about the centre of the resting face.
    displacement_mm (ny, nx, 3): at the nodes, z out of the sensor.
    pressure_mpa (ny, nx) >= 0, traction_mpa (ny, nx, 3): on the gel, per resting area. A node holds
    no sample but the mean around it, weighted with its hat (1 at the node, 0 at its neighbours), so
    `lattice.over_face` gives force_n to rounding; and with every traction at its node's displaced
    place, torque_nmm within 1 % of the force times the contact's radius.
    """

    @property
    def tip_mm(self) -> Point: ...
    @property
    def force_n(self) -> Point: ...
    @property
    def torque_nmm(self) -> Point: ...
    @property
    def contact_area_mm2(self) -> float: ...
    @property
    def displacement_mm(self) -> Field: ...
    @property
    def pressure_mpa(self) -> Field: ...
    @property
    def traction_mpa(self) -> Field: ...
    @property
    def diagnostics(self) -> IncrementDiagnostics: ...


class GelContact(Protocol):
    """One indenter against one gel; holds no history.

    x_mm (nx,), y_mm (ny,): the lattice, on the whole face. choice: what was picked and why.
    dofs: unknowns of the deformable body (displacements, or tractions of a linear level's grid).
    """

    level: Level
    x_mm: Field
    y_mm: Field
    choice: Choice
    dofs: int

    def rest(self, tip_mm: Point = (0.0, 0.0, 0.0)) -> State:
        """Without contact: nothing displaced, nothing remembered."""

    def solve(self, previous: Any, tip_mm: Point, seconds: float = 0.0, guide: Any = None) -> State:
        """One increment, straight from `previous`, which must be of this contact.

        seconds: that it takes; only a gel with a Prony series minds. guide: see `guide`.
        Raises InputError out of range, SolverError where it is not solved.
        """

    def guide(self, states: Sequence[Any]) -> Any:
        """From states of a coarser mesh along the same way, what `solve` then starts from.

        It changes the work and not what is solved. None where that does not help.
        """

    def lacking_rel(self, state: Any) -> float:
        """Of the normal force, what a hard contact would give more."""

    def path(
        self,
        previous: Any,
        tip_mm: Point,
        max_step_mm: float | None = None,
        seconds: float = 0.0,
    ) -> Iterator[State]:
        """The straight way in equal increments of at most max_step_mm (None: `choice.step_mm`).

        The way above the face is skipped.
        """
