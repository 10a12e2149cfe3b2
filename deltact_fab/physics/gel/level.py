"""Common interface of the levels of gel mechanics; `path.open.open_contact` makes a contact.

linear: small strain (`linear`). hyperelastic: finite strain (`finite`). tabulated: finite strain of
a few places, moved to others by the linear level (`tabulated`). All model the free sides, press an
`Indenter`, keep their history in the state and return the face on the same lattice, independent of
their mesh. Also sections and mirror planes of an indenter.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np

from deltact_fab.common import Field, InputError, Note, Point
from deltact_fab.sensor import GEL_LEVELS, Indenter, SkinDimensions

from .zones import ZoneMap, Zones

GelLevel = str
"""A name of GEL_LEVELS."""
LINEAR_LEVEL, TABULATED_LEVEL, FINITE_LEVEL = GEL_LEVELS
USUAL_MPA = 0.01, 10.0  # by hand: silicone gels and rubbers, with a margin on both sides


def unusual_material(modulus_mpa: float) -> str | None:
    """Warn of a Young's modulus outside the range of gels, possibly in another unit."""
    low, high = USUAL_MPA
    if low <= modulus_mpa <= high:
        return None
    return (
        f"{modulus_mpa:.3g} MPa is outside {low:g} to {high:g} MPa, the range of gels and rubbers"
    )


@dataclass(frozen=True)
class Reach:
    """Range of a path's tip: x_mm and y_mm (low, high) on the face, deepest_mm into the gel."""

    x_mm: tuple[float, float] = (0.0, 0.0)
    y_mm: tuple[float, float] = (0.0, 0.0)
    deepest_mm: float = 0.0

    @classmethod
    def around(cls, tips_mm: Iterable[Point]) -> Reach:
        """Return the smallest reach that contains tips (x, y, depth), at least one."""
        x, y, depth = np.array(list(tips_mm), dtype=np.float64).T
        return cls(
            (float(x.min()), float(x.max())), (float(y.min()), float(y.max())), float(depth.max())
        )

    @property
    def moves(self) -> bool:
        return self.x_mm[0] < self.x_mm[1] or self.y_mm[0] < self.y_mm[1]

    def require_on(self, skin: SkinDimensions) -> None:
        """Raise InputError for a tip at the gel's base or off the face."""
        if self.deepest_mm >= skin.thickness_mm:
            raise InputError(
                f"gel: depth {self.deepest_mm:g} mm is not below the gel's thickness of "
                f"{skin.thickness_mm:g} mm"
            )
        ways = zip("xy", (self.x_mm, self.y_mm), skin.opening_half_mm, strict=True)
        for name, (low, high), end in ways:
            if max(-low, high) > end:
                raise InputError(
                    f"gel: a tip from {name} = {low:g} to {high:g} mm leaves the face of "
                    f"+-{end:g} mm"
                )


@dataclass(frozen=True)
class Choice:
    """Level and mesh chosen for a press.

    spacing_mm: of the linear grid, or of cells at the contact. step_mm: of a path's increments.
    mirrors: planes x = 0, y = 0 at which the mesh ends. focus: box of fine cells
    (x_low, x_high, y_low, y_high). friction: of the solve, 0 where neglected.
    model_force_rel, model_in_plane_mm: model error of the level by the measured rule; 0 for the
    finite level. Mesh, mirrors and focus of the tabulated level are those of its press in the
    middle. reason: one line for a reader. goal_mm: cells that the tolerance requires,
    smaller than spacing_mm where most_unknowns limits them; 0: not chosen by tolerance.
    growth: ratio of neighbouring cells away from the focus; 1: of a linear grid.
    """

    model_share: ClassVar[float] = 0.5
    """Share of a tolerance that the level's own error may take."""
    level: GelLevel
    spacing_mm: float
    step_mm: float
    mirrors: tuple[bool, bool]
    focus: tuple[float, float, float, float]
    friction: float
    model_force_rel: float
    model_in_plane_mm: float
    reason: str
    goal_mm: float = 0.0
    growth: float = 1.0

    def times(self, spacing: float = 1.0, step: float = 1.0) -> Choice:
        """Scale cells or grid, and steps, by these factors.

        Growing cells scale too: with one growth for all meshes the cells away from the contact
        would be alike, and a comparison would not show their error.
        """
        return replace(
            self,
            spacing_mm=self.spacing_mm * spacing,
            step_mm=self.step_mm * step,
            growth=self.growth**spacing,
        )


@dataclass(frozen=True)
class IncrementDiagnostics:
    """Work and quality of the increment that led to a state; counts are sums over its parts.

    iterations: Newton's, or operator applications of the linear level. cuts: halvings of the
    increment. residual: of forces over the contact's, or of the contact conditions over the depth.
    penetration_mm: deepest, also between contact points. least_j: smallest volume ratio, or
    det(I + grad u_xy) of a linear face. most_stretch: None for the linear level. flags: warnings.
    Finite strain only: factorisations; damped: those with damping, as where the gel folds;
    lagged: parts whose friction is bounded by the pressures at their start.
    """

    iterations: int = 0
    factorisations: int = 0
    damped: int = 0
    lagged: int = 0
    cuts: int = 0
    residual: float = 0.0
    penetration_mm: float = 0.0
    least_j: float = 1.0
    most_stretch: float | None = None
    flags: tuple[Note, ...] = ()

    @classmethod
    def combine(cls, parts: Sequence[IncrementDiagnostics]) -> IncrementDiagnostics:
        """Combine the diagnostics of parts: the last one's, with counts summed."""
        counts = ("iterations", "factorisations", "damped", "lagged", "cuts")
        return replace(parts[-1], **{n: sum(getattr(p, n) for p in parts) for n in counts})


@dataclass(frozen=True, eq=False)
class State:
    """A solved position, also the history for the next one. Fields are on the lattice.

    inner: the level's own state; contact: the one that solved it. jumped: since first touch,
    friction was that of the pressures before a jump, and its slip remains in the history.
    force_n, torque_nmm: on the sensor, about the centre of the resting face.
    displacement_mm (ny, nx, 3): at the nodes, z out of the sensor.
    traction_mpa (ny, nx, 3): on the gel, per resting area. A node holds not a sample but the mean
    weighted with its hat (1 at the node, 0 at its neighbours), so the trapezoidal sum over the face
    gives force_n to rounding; and with every traction at its node's displaced position, torque_nmm
    within 1 % of the force times the contact's radius.
    """

    inner: Any
    force_n: Point
    torque_nmm: Point
    diagnostics: IncrementDiagnostics
    contact: Any
    jumped: bool = False

    @property
    def tip_mm(self) -> Point:
        """(x, y, depth) of the indenter's lowest point."""
        tip: Point = self.inner.tip_mm
        return tip

    @cached_property
    def zones(self) -> tuple[Zones, ZoneMap]:
        """Zones of the contact, and their map (ny, nx): 0 no contact, 1 slipping, 2 sticking."""
        contact_zones: tuple[Zones, ZoneMap] | None = self.contact.zones(self.inner)
        shape = len(self.contact.y_mm), len(self.contact.x_mm)
        return contact_zones or (Zones(centroid_mm=self.tip_mm[:2]), np.zeros(shape, np.uint8))

    @cached_property
    def displacement_mm(self) -> Field:
        return np.asarray(self.contact.displacement_mm(self.inner))

    @cached_property
    def traction_mpa(self) -> Field:
        return np.asarray(self.contact.traction_mpa(self.inner))


class GelContact:
    """One indenter against one gel; holds no history.

    x_mm (nx,), y_mm (ny,): lattice on the whole face. choice: level and mesh.
    dofs: unknowns of the deformable body (displacements, or tractions of the linear grid).
    Subclasses compute displacement_mm, traction_mpa and zones of an inner state, as in `State`.
    """

    level: GelLevel
    x_mm: Field
    y_mm: Field
    choice: Choice
    dofs: int

    def rest(self, tip_mm: Point = (0.0, 0.0, 0.0)) -> State:
        """Return the state without contact and history."""
        raise NotImplementedError

    def solve(self, previous: Any, tip_mm: Point, seconds: float = 0.0, guide: Any = None) -> State:
        """Solve one increment, straight from `previous`, a state of this contact.

        seconds: duration, for a gel with a Prony series. guide: see `guide`.
        Raises InputError out of range, SolverError where it is not solved.
        """
        raise NotImplementedError

    def guide(self, states: Sequence[Any]) -> Any:
        """Make a starting point of `solve` from states of a coarser mesh along the same path.

        It changes the work, not the solution. None where it does not help.
        """
        return None

    def lacking_rel(self, state: Any) -> float:
        """Missing normal force, relative: what a hard contact would add."""
        return 0.0


def follow_path(
    contact: Any, previous: Any, tip_mm: Point, max_step_mm: float,
    seconds: float | None = None, guide: Any = None,
) -> Iterator[Any]:  # fmt: skip
    """Yield the states of a contact along the straight path to tip_mm, in equal increments.

    max_step_mm: longest increment. seconds: of the whole path, at constant speed; guide: requires
    seconds, see `GelContact.solve`. The path above the face is skipped, so the first increment
    starts at first touch; a move that ends without contact gives one state of rest. Raises
    InputError for an invalid step, and the errors of the contact's `solve`.
    """
    if not (math.isfinite(max_step_mm) and max_step_mm > 0):
        raise InputError(f"contact: max_step_mm must be positive and finite, not {max_step_mm}")
    start, end = np.array(previous.tip_mm), np.array(tip_mm, dtype=np.float64)
    if start[2] < 0 < end[2]:
        start = start + (end - start) * (-start[2] / (end[2] - start[2]))
    length_mm = float(np.linalg.norm(end - start)) if end[2] > 0 else 0.0
    n = max(1, math.ceil(length_mm / max_step_mm - 1e-9)) if math.isfinite(length_mm) else 1
    extras = () if seconds is None else (seconds / n, guide)
    state = previous
    for i in range(1, n + 1):
        point = start + (end - start) * (i / n) if i < n else end
        state = contact.solve(state, (float(point[0]), float(point[1]), float(point[2])), *extras)
        yield state


# Steps of the R2 sequence, which fills a square evenly: definition by Roberts (2018).
R2_STEPS = 0.7548776662466927, 0.5698402909980532
MIRROR_TOLERANCE_MM = 1e-6  # by hand: above rounding, below any edge


def is_mirrored(indenter: Indenter, axis: int) -> bool:
    """True if an indenter is symmetric about the plane x = 0 (axis 0) or y = 0 (axis 1).

    Compares its underside at points that no symmetry puts on an edge.
    """
    k = np.arange(1, 2001)
    half = indenter.footprint_half_mm
    steps = zip(R2_STEPS, half, strict=True)
    x, y = (np.asarray((2 * ((c * k) % 1) - 1) * h, np.float64) for c, h in steps)
    mirrored: tuple[Field, Field] = (-x, y) if axis == 0 else (x, -y)
    height, mirrored_height = indenter.height_mm(x, y), indenter.height_mm(*mirrored)
    return bool(np.allclose(height, mirrored_height, rtol=0, atol=MIRROR_TOLERANCE_MM))


def contact_radius_mm(indenter: Indenter, depth_mm: float) -> float:
    """Radius of the largest circle in the section at half the depth: Hertz' a^2 = R d of a ball."""
    return _sections(indenter, depth_mm)[0]


def section_half_mm(indenter: Indenter, depth_mm: float) -> tuple[float, float]:
    """Half sides (x, y) of the box around the section at the whole depth, about the axis."""
    return _sections(indenter, depth_mm)[1]


@lru_cache(maxsize=64)
def _sections(indenter: Indenter, depth_mm: float) -> tuple[float, tuple[float, float]]:
    from scipy.ndimage import distance_transform_edt

    boxes = []
    radius = 0.0
    half_x, half_y = indenter.footprint_half_mm
    for part in (1.0, 0.5):
        # Zoom in on a light touch, to resolve a section at a few hundredths of a millimetre.
        size = max(half_x, half_y)
        for _ in range(6):
            cell = size / 100
            x = np.arange(-101, 102) * cell
            height = indenter.height_mm(*np.meshgrid(x, x))
            inside = np.isfinite(height) & (height <= part * depth_mm)
            extents = [np.abs(x[inside.any(axis=k)]).max(initial=0.0) for k in (0, 1)]
            if max(extents) >= size / 4:
                break
            size = max(2 * max(extents), 4 * cell)
        boxes.append((float(extents[0]) + cell / 2, float(extents[1]) + cell / 2))
        if part < 1:
            radius = float(distance_transform_edt(inside).max()) * cell
    return float(max(radius, cell)), boxes[0]
