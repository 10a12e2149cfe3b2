"""One gel, three levels of mechanics behind one interface; `open_contact` picks or takes one.

layer: linear, bonded, no sides (`layer`). block: linear with free sides (`block`). hyperelastic:
finite strain, free sides (`finite`). All press an `Indenter`, keep their history in the state and
show the face on one and the same lattice, whatever they compute on.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..shapes import Indenter, SkinDimensions
from .material import GelMaterial

if TYPE_CHECKING:
    from .choose import Choice

Field = NDArray[np.float64]
Point = tuple[float, float, float]
Level = Literal["layer", "block", "hyperelastic"]

LEVELS: tuple[Level, ...] = get_args(Level)


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
class Diagnostics:
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
    displacement_mm (ny, nx, 3): z out of the sensor. pressure_mpa (ny, nx), traction_mpa
    (ny, nx, 3): on the gel, per resting area.
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
    def diagnostics(self) -> Diagnostics: ...


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

    def solve(self, previous: Any, tip_mm: Point, seconds: float = 0.0) -> State:
        """One increment, straight from `previous`, which must be of this contact.

        seconds: that it takes; only a gel with a Prony series minds.
        Raises InputError out of range, SolverError where it is not solved.
        """

    def path(
        self,
        previous: Any,
        tip_mm: Point,
        max_step_mm: float | None = None,
        seconds: float = 0.0,
        like: Sequence[Any] = (),
    ) -> Iterator[State]:
        """The straight way in equal increments of at most max_step_mm (None: `choice.step_mm`).

        The way above the face is skipped. like: states of a coarser mesh of this level along the
        same way, which the solver then starts from; they do not change what is solved.
        """


def open_contact(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    *,
    level: Level | Literal["auto"] = "auto",
    tolerance: float = 0.03,
    friction: float | None = None,
    observe_shear: bool = True,
    reach: Reach,
    lattice_mm: float = 0.25,
    spacing_mm: float | None = None,
) -> GelContact:
    """The contact that keeps to a tolerance, or that of a named level.

    tolerance: of the force, relative; in plane `choose.IN_PLANE_MM` rms goes with the default.
    friction: None takes the material's. observe_shear: False leaves friction out where the path
    does not shear and it changes the force by little; see `choose.pick`.
    lattice_mm: largest distance of lattice nodes. spacing_mm: of the grid or mesh, None: chosen.
    Raises InputError where the level cannot do it, naming what can.
    """
    from .choose import pick

    if level != "auto" and level not in LEVELS:
        raise InputError(f"gel: level {level!r}: valid: auto, {', '.join(LEVELS)}")
    if not (math.isfinite(lattice_mm) and 0.02 <= lattice_mm <= skin.length_mm / 8):
        raise InputError(
            f"gel: lattice_mm must be 0.02 to {skin.length_mm / 8:g} mm: {lattice_mm} fails"
        )
    mu = material.friction if friction is None else friction
    choice = pick(
        skin, material, indenter, reach, tolerance,
        level=level, friction=mu, observe_shear=observe_shear, spacing_mm=spacing_mm,
    )  # fmt: skip
    return contact_of(skin, material, indenter, choice, lattice_mm)


def contact_of(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    choice: Choice,
    lattice_mm: float = 0.25,
) -> GelContact:
    """The contact that a choice describes; lattice_mm as in `open_contact`."""
    x, y = (_lattice(half, lattice_mm) for half in skin.opening_half_mm)
    if choice.level == "hyperelastic":
        from .finite.gel import FiniteGel

        return FiniteGel(skin, material, indenter, choice, x, y)
    from .linear.gel import LinearGel

    return LinearGel(skin, material, indenter, choice, x, y)


def _lattice(half_mm: float, spacing_mm: float) -> Field:
    """From -half to half; 0 is a node."""
    n = max(1, math.ceil(half_mm / spacing_mm - 1e-9))
    return np.linspace(-half_mm, half_mm, 2 * n + 1)
