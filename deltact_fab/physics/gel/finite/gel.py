"""Finite-strain gel, a `level.GelContact`: wrenches, lattice fields, flags."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deltact_fab.common import Field, InputError, Note, Point
from deltact_fab.sensor import GelMaterial, Indenter, SkinDimensions

from ..level import Choice, GelContact, IncrementDiagnostics, Reach, State, follow_path
from ..zones import FRICTION_MARGIN, ZoneMap, Zones, contact_share, hermite, means, measure_zones
from .distance import gap
from .mesh import HexMesh, block_mesh
from .press import FinitePress
from .state import PENETRATION_LIMIT, FiniteState, Guide


class FaceLattice:
    """Lattice x_mm (nx,), y_mm (ny,) on the touched face of a block, its mirrors unfolded.

    Displacements: a cubic through the four nodes next to a point, along x and then along y
    (piecewise Hermite, slopes of the parabola through three nodes). It is C1, exact for parabolas
    at any grading, and a kink at the contact's edge is felt one cell away at most; a spline would
    ring. Tractions: every contact point represents a part of its face as large as its weight, and
    the parts are averaged to the nodes by area (`zones.means`), conserving the force.
    """

    def __init__(self, mesh: HexMesh, x_mm: Field, y_mm: Field) -> None:
        assert mesh.axes_mm is not None, "of a block"
        self.mesh, self.x_mm, self.y_mm = mesh, x_mm, y_mm
        knots = [mesh.axes_mm[0], mesh.axes_mm[1]]
        self._shape = (len(knots[1]), len(knots[0]))
        self._along = [
            hermite(unfolded(k) if mirror else k, nodes)
            for k, nodes, mirror in zip(knots, (x_mm, y_mm), mesh.mirrors, strict=True)
        ]
        self._knots = knots
        self._means: dict[int, list[Field]] = {}

    def displacement_mm(self, nodes_mm: Field) -> Field:
        """Interpolate the displacements (n, 3) of all nodes to (ny, nx, 3)."""
        ny, nx = self._shape
        u = np.moveaxis(nodes_mm[-ny * nx :].reshape(ny, nx, 3), -1, 0)
        if self.mesh.mirrors[0]:
            sign = np.array([-1.0, 1.0, 1.0])[:, None, None]
            u = np.concatenate([sign * u[:, :, :0:-1], u], axis=2)
        if self.mesh.mirrors[1]:
            sign = np.array([1.0, -1.0, 1.0])[:, None, None]
            u = np.concatenate([sign * u[:, :0:-1], u], axis=1)
        wx, wy = self._along
        return np.ascontiguousarray(np.moveaxis(wy @ u @ wx.T, 0, -1))

    def average_points(self, values: Field) -> Field:
        """Average vectors at the contact points (f, q, 3) to (ny, nx, 3)."""
        n = math.isqrt(values.shape[1])
        ny, nx = (size - 1 for size in self._shape)
        parts = values.reshape(ny, nx, n, n, -1).swapaxes(1, 2).reshape(ny * n, nx * n, -1)
        for axis, mirror in enumerate(self.mesh.mirrors):
            if mirror:
                image = np.flip(parts, axis=1 - axis).copy()
                image[..., axis] *= -1
                parts = np.concatenate([image, parts], axis=1 - axis)
        wx, wy = self._to_means(n)
        return np.ascontiguousarray(np.moveaxis(wy @ np.moveaxis(parts, -1, 0) @ wx.T, 0, -1))

    def _to_means(self, n: int) -> list[Field]:
        if n not in self._means:
            ends = np.cumsum(np.polynomial.legendre.leggauss(n)[1]) / 2
            self._means[n] = []
            for k, nodes, mirror in zip(
                self._knots, (self.x_mm, self.y_mm), self.mesh.mirrors, strict=True
            ):
                edges = np.append(k[0], k[:-1, None] + np.diff(k)[:, None] * ends)
                self._means[n].append(means(unfolded(edges) if mirror else edges, nodes))
        return self._means[n]


def tractions_mpa(press: FinitePress, state: FiniteState) -> Field:
    """Return tractions on the gel, per resting area, at the contact points (f, q, 3)."""
    contact = press.surface.evaluate(state.displacement_mm, np.array(state.tip_mm), tangent=False)
    normal = contact.gap.normal.reshape(state.shear_mpa.shape)
    return state.pressure_mpa[..., None] * normal + state.shear_mpa


def unfolded(half: Field) -> Field:
    """Return coordinates from 0 on, continued to the other side of the mirror."""
    return np.concatenate([-half[:0:-1], half])


DEPTH_STEP_MM = 1e-5  # by hand: difference step, between rounding and curvature


def lacking_n(press: FinitePress, state: FiniteState) -> float:
    """Missing normal force dC/dd (N): what a hard contact would add. Friction is neglected."""
    if state.contact_points == 0:
        return 0.0
    u, tip = state.displacement_mm, np.array(state.tip_mm)
    free = press.pattern.free
    down = np.array([0.0, 0.0, DEPTH_STEP_MM])
    low, high = (press.surface.evaluate(u, tip + k * down, tangent=False) for k in (-1, 1))
    by_depth = ((high.force_n - low.force_n) / (2 * DEPTH_STEP_MM))[free]
    bulk = press.bulk.evaluate(u, True, state.cell_pressure_mpa)
    for curved in (True, False):
        contact = press.surface.evaluate(u, tip, curved=curved)
        press.solver.factorise(press.pattern.matrix(bulk.data + contact.data))
        if not press.solver.negative:
            break
    _, slope = press.surface.complementary_energy(u, tip)
    return float(slope[:, 2].sum() - press.solver.solve(slope[free]) @ by_depth)


# Up to about here neo-Hooke follows rubber in tension within a third (Treloar 1944, Trans. Faraday
# Soc. 40); soft silicones tear at 3 to 5.
STRETCH_LIMIT = 3.0
# By hand: nodes of the zones' lattice along a cell and in all; more cost time, fewer blur the rim.
NODES_PER_CELL, MAX_ZONE_NODES = 8, 400
LONGEST_RUB = 1 / 8  # of the thickness: longest increment with friction; docs/evidence/gel.md


class FiniteGel(GelContact):
    level = "hyperelastic"

    def __init__(
        self,
        skin: SkinDimensions,
        material: GelMaterial,
        indenter: Indenter,
        choice: Choice,
        x_mm: Field,
        y_mm: Field,
    ) -> None:
        self.choice, self.x_mm, self.y_mm = choice, x_mm, y_mm
        self._skin = skin
        mesh = block_mesh(skin, choice.spacing_mm, choice.focus, choice.mirrors, choice.growth)
        self.dofs = mesh.free_dofs
        self.press = FinitePress(mesh, material, indenter, friction=choice.friction)
        self._lattice = FaceLattice(mesh, x_mm, y_mm)

    def rest(self, tip_mm: Point = (0.0, 0.0, 0.0)) -> State:
        return self._state(self.press.rest(tip_mm), jumped=False)

    def solve(
        self, previous: State, tip_mm: Point, seconds: float = 0.0, guide: Guide | None = None
    ) -> State:
        """One increment, halved where it does not converge.

        With friction a long one is solved in equal parts, since friction is of first order in them:
        10 mm in one part ended 14 % below ten. The diagnostics cover all parts.
        Raises InputError for a tip off the face, off the mesh's mirror or at the gel's base;
        SolverError as `FinitePress.solve` does.
        """
        self._require_on_mesh(tip_mm)
        inner, longest_mm = previous.inner, math.inf
        if self.choice.friction > 0 and tip_mm[2] > 0:
            longest_mm = max(self.choice.step_mm, LONGEST_RUB * self._skin.thickness_mm)
        if _rubbed_mm(inner.tip_mm, tip_mm) <= longest_mm:
            state = self.press.solve(inner, tip_mm, seconds, guide)
        else:
            below = _share_below(inner.tip_mm, tip_mm)
            if below < 1:  # start at first touch
                start, end = np.array(inner.tip_mm), np.array(tip_mm, dtype=np.float64)
                point = end + (start - end) * below
                touch = (float(point[0]), float(point[1]), 0.0)
                inner = self.press.solve(inner, touch, seconds * (1 - below))
            path = follow_path(self.press, inner, tip_mm, longest_mm, seconds * below, guide)
            parts = list(path)
            work = IncrementDiagnostics.combine([part.diagnostics for part in parts])
            state = replace(parts[-1], diagnostics=work)
        return self._state(state, previous.jumped)

    def guide(self, states: Sequence[State]) -> Guide | None:
        if not states:
            return None
        coarse = states[0].contact.press.mesh
        return Guide(coarse, [s.inner for s in states], self.press.mesh)

    def lacking_rel(self, state: State) -> float:
        """Missing normal force, relative; see `lacking_n`."""
        force = -state.inner.force_n[2]
        return lacking_n(self.press, state.inner) / force if force > 0 else 0.0

    def displacement_mm(self, inner: FiniteState) -> Field:
        return self._lattice.displacement_mm(inner.displacement_mm)

    def traction_mpa(self, inner: FiniteState) -> Field:
        """Return tractions (ny, nx, 3) on the lattice, averaged over the parts of faces."""
        return self._lattice.average_points(tractions_mpa(self.press, inner))

    def zones(self, inner: FiniteState) -> tuple[Zones, ZoneMap] | None:
        """Return the zones on a lattice around the contact; None without contact."""
        from scipy.ndimage import distance_transform_edt

        touched, mesh, surface = inner.pressure_mpa > 0, self.press.mesh, self.press.surface
        if not touched.any():
            return None
        cell_mm, axes = self.choice.spacing_mm, []
        points_mm = np.matmul(surface.shape, mesh.nodes_mm[mesh.faces])[touched]
        for k, half in enumerate(self._skin.opening_half_mm):
            high = min(half, points_mm[:, k].max() + 3 * cell_mm)
            low = -high if mesh.mirrors[k] else max(-half, points_mm[:, k].min() - 3 * cell_mm)
            count = min(NODES_PER_CELL * math.ceil((high - low) / cell_mm), MAX_ZONE_NODES)
            axes.append(np.linspace(low, high, count + 1))
        lattice = FaceLattice(mesh, *axes)
        place = lattice.displacement_mm(inner.displacement_mm)
        place[..., :2] += np.stack(np.meshgrid(*axes), axis=-1)
        offsets_mm = (place - np.array(inner.tip_mm) * [1, 1, -1]).reshape(-1, 3)
        gap_mm = gap(self.press.indenter, offsets_mm).distance_mm.reshape(place.shape[:2])
        bound = self.press.friction * inner.pressure_mpa * (1 - FRICTION_MARGIN)
        sticking = np.linalg.norm(inner.shear_mpa, axis=2) < bound
        # Not in the first two components: a mirror changes their sign.
        flags = np.stack([sticking, sticking, sticking, touched], axis=2).astype(np.float64)
        sticks, near = np.moveaxis(lattice.average_points(flags)[..., 2:] > 0.5, -1, 0)
        nearest = distance_transform_edt(~near, return_distances=False, return_indices=True)
        edge_mm = surface.indenter.edge_radius_mm
        # At a sharp edge the cells do not resolve where on its rounding the contact ends.
        off_mm = edge_mm / 2 if edge_mm < cell_mm else 0.0
        steps = [axis_mm[1] - axis_mm[0] for axis_mm in reversed(axes)]
        share = contact_share(gap_mm, near, cell_mm, steps)
        return measure_zones(
            axes, place[..., :2], share, sticks[tuple(nearest)], cell_mm, off_mm,
            (self.x_mm, self.y_mm),
        )  # fmt: skip

    def _require_on_mesh(self, tip_mm: Point) -> None:
        x, y, depth = tip_mm
        Reach((x, x), (y, y), depth).require_on(self._skin)
        for name, position, mirror in zip("xy", (x, y), self.choice.mirrors, strict=True):
            if mirror and abs(position) > 1e-9:
                raise InputError(
                    f"gel: the mesh ends at its mirror plane {name} = 0; a tip at "
                    f"{name} = {position:g} mm needs a reach that includes it"
                )

    def _state(self, inner: FiniteState, jumped: bool) -> State:
        d = inner.diagnostics
        jumped = inner.contact_points > 0 and (jumped or d.lagged > 0)
        depth = max(inner.tip_mm[2], 0.0)
        flags = []
        coarse = self.choice.spacing_mm / self.choice.goal_mm if self.choice.goal_mm else 1.0
        if coarse > 1:
            text = (
                f"cells of {self.choice.spacing_mm:g} mm where the tolerance requires "
                f"{self.choice.goal_mm:g} mm: errors may be {coarse**2:.1f} times as large"
            )
            flags.append(Note("mesh", text))
        if d.penetration_mm > PENETRATION_LIMIT * depth:
            text = (
                f"the indenter is {d.penetration_mm:.2g} mm inside the gel, over "
                f"{PENETRATION_LIMIT:.0%} of the depth {depth:g} mm; a spacing below "
                f"{self.choice.spacing_mm:g} mm is needed"
            )
            flags.append(Note("penetration", text))
        if d.most_stretch is not None and d.most_stretch > STRETCH_LIMIT:
            text = (
                f"{d.most_stretch:.2f}, past {STRETCH_LIMIT:g}: neo-Hooke errs by a third there "
                "and soft silicones may tear"
            )
            flags.append(Note("stretch", text))
        if d.lagged or jumped:
            current_text = (
                "the gel jumped; friction is bounded by the pressures before the jump, since no "
                "equilibrium was found with those after it"
            )
            history_text = (
                "the gel jumped earlier, with friction bounded by the pressures before the jump; "
                "that slip is part of the history"
            )
            flags.append(Note("friction", current_text if d.lagged else history_text))
        force, torque = self.press.wrench(inner)
        return State(
            inner,
            (float(force[0]), float(force[1]), float(force[2])),
            (float(torque[0]), float(torque[1]), float(torque[2])),
            replace(d, flags=tuple(flags)),
            self,
            jumped,
        )


def _share_below(start: Point, end: Point) -> float:
    """Fraction of a move into the gel that lies below the face."""
    return 1.0 if start[2] >= 0 else end[2] / (end[2] - start[2])


def _rubbed_mm(start: Point, end: Point) -> float:
    """Length of a move below the face; 0 where it ends above."""
    return _share_below(start, end) * math.dist(start, end) if end[2] > 0 else 0.0
