"""Contact of the touched face with a rigid indenter.

Normal: a penalty on the signed distance g at Gauss points of a face, pressure p(g) = k times the
ramp of -g, rounded over a width w so that it is C1 (Wriggers, Computational Contact Mechanics,
ch. 5 and 10). k = 50 E/h and w = 0.03 h for cells h, and k grows with the penetration, which so
shrinks with the mesh and lowers the force by about as much as the mesh raises it.
Tangential: with the slip e since the last release and the bound b = friction x pressure, the
return mapping of Coulomb's law, t e up to |e| = b/t and b e/|e| beyond, t = 10 E/h. With b held it
is the derivative of Huber's function, its tangent symmetric; `Coupling` lets b follow pressure.
Tractions act per resting area.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field
from deltact_fab.sensor import Indenter

from .assembly import FACE_UPPER, MatrixPattern
from .distance import Gap, gap
from .mesh import HexMesh

# By hand: stiffer and narrower penetrate less, but Newton's method takes more iterations.
CONTACT_STIFFNESS = 50.0  # k h / E
FRICTION_STIFFNESS = 10.0  # t h / E, along the face
HARDENING_CELLS = 0.05  # over h: penetration at which the pressure is twice that of k
MAX_HARDENING = 2.0  # times that penetration: deeper, the pressure rises linearly
RAMP_WIDTH = 0.03  # w / h
RAMP_DEPTH_SHARE = 0.2  # largest w over the depth


@dataclass(frozen=True, eq=False)
class FrictionGrip:
    """History of friction for one solve; arrays over (faces f, points q of a face).

    at_mm (f, q, 3): points relative to the indenter at the start of the increment.
    slip_mm (f, q, 3): elastic slip stored there. normal (f, q, 3): frozen.
    touching (f, q): points in contact then or about to touch; others are frictionless.
    friction: Coulomb coefficient. bound_mpa (f, q): fixed bound of the shear; None: friction x
    pressure.
    """

    at_mm: Field
    slip_mm: Field
    normal: Field
    touching: NDArray[np.bool_]
    friction: float
    bound_mpa: Field | None = None


class Coupling(NamedTuple):
    """Tangent of slipping points' shear by their pressure: d(shear) = gain slip_direction (normal
    . du) on the indenter, gain_n_mm (f, q) with the points' weights, directions (f, q, 3)."""

    gain_n_mm: Field
    slip_direction: Field
    normal: Field


class ContactEvaluation(NamedTuple):
    """Result of one evaluation. energy_nmm: of the normal penalty, and of friction with a fixed
    bound. force_n (n, 3): on the indenter.
    data: CSR entries of the tangent's symmetric part, empty if not requested. coupling: its
    unsymmetric part or None. pressure_mpa (f, q), shear_mpa (f, q, 3) on the gel, gap: over f x q.
    """

    energy_nmm: float
    force_n: Field
    data: Field
    coupling: Coupling | None
    pressure_mpa: Field
    shear_mpa: Field
    gap: Gap


class Surface:
    """Touched face of a mesh and its contact points.

    points: q is its square, the points lie in rows along the face's first side.
    weights_mm2 (f, q): resting area. stiffness (f, 1) in MPa/mm. width_mm (f, 1).
    """

    def __init__(
        self,
        mesh: HexMesh,
        pattern: MatrixPattern,
        indenter: Indenter,
        modulus_mpa: float,
        points: int = 2,
    ) -> None:
        self.mesh, self.pattern, self.indenter = mesh, pattern, indenter
        self.faces = mesh.faces
        self.shape, slope, share = _gauss(points)
        x = mesh.nodes_mm[self.faces][..., :2]
        jacobian = np.einsum("qaj,fai->fqij", slope, x)
        self.weights_mm2: Field = share * np.linalg.det(jacobian)
        size = np.sqrt(self.weights_mm2.sum(axis=1))[:, None]
        self._size = size
        self.stiffness: Field = CONTACT_STIFFNESS * modulus_mpa / size
        self.grip_stiffness: Field = FRICTION_STIFFNESS * modulus_mpa / size
        self.width_mm: Field = RAMP_WIDTH * size

    def points(self, displacement_mm: Field, tip_mm: Field) -> Field:
        """Points (f, q, 3) relative to the indenter with its lowest point at (x, y, -depth)."""
        x = (self.mesh.nodes_mm + displacement_mm)[self.faces]
        origin = np.array([tip_mm[0], tip_mm[1], -tip_mm[2]])
        return np.matmul(self.shape, x) - origin

    def evaluate(
        self,
        displacement_mm: Field,
        tip_mm: Field,
        grip: FrictionGrip | None = None,
        tangent: bool = True,
        curved: bool = True,
    ) -> ContactEvaluation:
        """Return forces and tangent; `curved` False drops -p grad^2 g, which may be negative."""
        points = self.points(displacement_mm, tip_mm)
        near = self._near(points)
        shape = points.shape[:2]
        normal = near.normal.reshape(*shape, 3)
        psi, pressure, rise = self._ramp(near.distance_mm.reshape(shape), float(tip_mm[2]))
        w = self.weights_mm2
        energy = float((w * psi).sum())
        pull = -pressure[..., None] * normal
        shear = np.zeros_like(normal)
        block, coupling, bound = None, None, np.zeros_like(pressure)
        if tangent:
            block = rise[..., None, None] * normal[..., :, None] * normal[..., None, :]
            if curved:
                block -= pressure[..., None, None] * near.curvature_per_mm.reshape(*shape, 3, 3)
        if grip is not None:
            free = grip.bound_mpa is None
            bound = grip.friction * pressure if grip.bound_mpa is None else grip.bound_mpa
            bound = np.where(grip.touching, bound, 0.0)
            traction, slid, slips, stiff = self._friction(points, grip, bound, tangent)
            if not free:
                # k e^2/2 up to the bound, b e - b^2/(2k) beyond (Huber).
                shear_mpa = np.linalg.norm(traction, axis=2)
                elastic = shear_mpa**2 / (2 * self.grip_stiffness)
                energy += float((w * np.where(slips, bound * slid - elastic, elastic)).sum())
            pull = pull + traction
            shear = -traction
            if block is not None and stiff is not None:
                block += stiff
                if free:
                    size = np.maximum(np.linalg.norm(traction, axis=2), 1e-300)
                    gain = np.where(slips & grip.touching, -grip.friction * rise, 0.0) * w
                    coupling = Coupling(gain, traction / size[..., None], normal)
        nodal = np.matmul(self.shape.T, w[..., None] * pull)
        force = self.mesh.at_nodes(self.faces, nodal)
        data = np.empty(0)
        if block is not None:
            # A fixed bound persists where contact opens.
            active = pressure + bound > 0
            data = self._matrix_entries(block * w[..., None, None], np.any(active, axis=1))
        return ContactEvaluation(energy, force, data, coupling, pressure, shear, near)

    def complementary_energy(self, displacement_mm: Field, tip_mm: Field) -> tuple[float, Field]:
        """Complementary energy (Nmm) of the penalty, and its gradient (n, 3).

        To first order, the elastic energy missing at a depth because of the penalty's compliance.
        """
        near = self._near(self.points(displacement_mm, tip_mm))
        q = -near.distance_mm.reshape(self.weights_mm2.shape)
        psi, pressure, rise = self._ramp(-q, float(tip_mm[2]))
        energy = float((self.weights_mm2 * (pressure * q - psi)).sum())
        pull = (self.weights_mm2 * q * rise)[..., None] * near.normal.reshape(*q.shape, 3)
        return energy, -self.mesh.at_nodes(self.faces, np.matmul(self.shape.T, pull))

    def coupling_force(self, coupling: Coupling, step_mm: Field) -> Field:
        """Change (n, 3) of the nodal forces with displacements (n, 3), by the coupling alone."""
        move = np.matmul(self.shape, step_mm[self.faces])
        change = coupling.gain_n_mm * (coupling.normal * move).sum(axis=2)
        return self.mesh.at_nodes(
            self.faces, np.matmul(self.shape.T, change[..., None] * coupling.slip_direction)
        )

    def normals(self, at_mm: Field) -> Field:
        """Outward normals (f, q, 3) of the indenter next to points (f, q, 3)."""
        return self._near(at_mm).normal.reshape(at_mm.shape)

    def _near(self, points: Field) -> Gap:
        """Return the gap at points (f, q, 3); far from the indenter a flat lower bound."""
        flat = points.reshape(-1, 3)
        margin = 2 * float(self.width_mm.max())
        half = self.indenter.footprint_half_mm
        lateral = np.maximum(np.abs(flat[:, 0]) - half[0], np.abs(flat[:, 1]) - half[1])
        below = -flat[:, 2]
        plate = self.indenter.reach_mm + below
        lower_bound = np.maximum(below, np.minimum(lateral, plate))
        close = lower_bound < margin
        n = len(flat)
        if close.all():
            return gap(self.indenter, flat)
        exact = gap(self.indenter, flat[close])
        distance, normal = lower_bound, np.tile([0.0, 0.0, -1.0], (n, 1))
        curvature = np.zeros((n, 3, 3))
        distance[close], normal[close] = exact.distance_mm, exact.normal
        curvature[close] = exact.curvature_per_mm
        return Gap(distance, normal, curvature)

    def deepest_mm(self, displacement_mm: Field, tip_mm: Field) -> float:
        """Deepest penetration at 5 x 5 points per face, also between the contact points."""
        s = np.linspace(-1.0, 1.0, 5)
        eta, xi = (c.ravel() for c in np.meshgrid(s, s, indexing="ij"))
        shape = _bilinear(xi, eta)
        x = (self.mesh.nodes_mm + displacement_mm)[self.faces]
        origin = np.array([tip_mm[0], tip_mm[1], -tip_mm[2]])
        points = (np.matmul(shape, x) - origin).reshape(-1, 3)
        return max(0.0, -float(gap(self.indenter, points).distance_mm.min()))

    def _ramp(self, g: Field, depth_mm: float) -> tuple[Field, Field, Field]:
        """Potential (N/mm), pressure (MPa) and its slope (MPa/mm) at distances g (f, q).

        The ramp is centred on g = 0, so it pushes from a distance of w/2; near first touch w
        shrinks with the depth, to nothing at depth 0.
        """
        k, w = self.stiffness, np.clip(RAMP_DEPTH_SHARE * depth_mm, 1e-9, self.width_mm)
        q = -g
        s = np.clip(q + w / 2, 0.0, w)
        excess = np.maximum(q - w / 2, 0.0)
        # Round part up to q = w/2, then the straight ramp on from there.
        ramp, slope = s**2 / (2 * w) + excess, np.where(q > -w / 2, s / w, 0.0)
        a2 = 1 / (HARDENING_CELLS * self._size) ** 2
        # Linear from `cap` on: Newton reduces a cubic by only a third per step.
        cap = MAX_HARDENING * HARDENING_CELLS * self._size
        curved, straight = np.minimum(ramp, cap), np.maximum(ramp - cap, 0.0)
        steepest = 1 + 3 * a2 * cap**2
        pressure = k * (curved * (1 + a2 * curved**2) + steepest * straight)
        rise = k * slope * np.where(straight > 0, steepest, 1 + 3 * a2 * curved**2)
        full = np.minimum(w / 2 + excess, cap)
        psi = s**3 / (6 * w) + a2 * s**7 / (56 * w**3)
        psi = psi + (full**2 - (w / 2) ** 2) / 2 + a2 * (full**4 - (w / 2) ** 4) / 4
        psi = psi + cap * (1 + a2 * cap**2) * straight + steepest * straight**2 / 2
        return k * psi, pressure, rise

    def _friction(
        self, points: Field, grip: FrictionGrip, bound_mpa: Field, tangent: bool
    ) -> tuple[Field, Field, NDArray[np.bool_], Field | None]:
        """Return traction on the indenter (f, q, 3), slip with the elastic part (f, q), mask of
        reached bounds (f, q), tangent (f, q, 3, 3) at a fixed bound."""
        k, b, n = self.grip_stiffness, bound_mpa, grip.normal
        e = grip.slip_mm + points - grip.at_mm
        e = e - (e * n).sum(axis=2, keepdims=True) * n
        size = np.linalg.norm(e, axis=2)
        slips = k * size > b
        safe = np.maximum(size, 1e-300)
        # The slope of the secant: k in stick, b/|e| in slip.
        secant = np.where(slips, b / safe, k)
        if not tangent:
            return secant[..., None] * e, size, slips, None
        unit = e / safe[..., None]
        flat = np.eye(3) - n[..., :, None] * n[..., None, :]
        slide = np.where(slips, 1.0, 0.0)[..., None, None] * unit[..., :, None] * unit[..., None, :]
        return secant[..., None] * e, size, slips, secant[..., None, None] * (flat - slide)

    def _matrix_entries(self, block: Field, active: NDArray[np.bool_]) -> Field:
        """CSR entries of point stiffnesses (f, q, 3, 3) on the active faces."""
        pairs = np.einsum("qa,qb->qab", self.shape, self.shape)
        cells = np.einsum("qab,fqij->faibj", pairs, block[active], optimize=True)
        flat = cells.reshape(-1, 12, 12)[:, FACE_UPPER[0], FACE_UPPER[1]]
        return self.pattern.add(self.pattern.face_slots[active], flat)


def _bilinear(xi: Field, eta: Field) -> Field:
    """Shape functions (q, 4) of the square, counterclockwise from (-1, -1)."""
    sx, sy = np.array([-1, 1, 1, -1]), np.array([-1, -1, 1, 1])
    return (1 + xi[:, None] * sx) * (1 + eta[:, None] * sy) / 4


def _gauss(n: int) -> tuple[Field, Field, Field]:
    """Values (q, 4), slopes (q, 4, 2) and weights (q,) at the n x n Gauss points, row by row."""
    nodes, weight = np.polynomial.legendre.leggauss(n)
    eta, xi = (c.ravel() for c in np.meshgrid(nodes, nodes, indexing="ij"))
    sx, sy = np.array([-1, 1, 1, -1]), np.array([-1, -1, 1, 1])
    slope = np.stack([sx * (1 + eta[:, None] * sy) / 4, sy * (1 + xi[:, None] * sx) / 4], axis=2)
    return _bilinear(xi, eta), slope, np.outer(weight, weight).ravel()
