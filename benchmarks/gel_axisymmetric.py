"""A cylinder of gel under a ball or a flat punch: axisymmetric, finite strain, friction.

Shares no line with `deltact_fab.physics.gel.finite`. Nine-node quadrilaterals in (r, z); energy
    mu/2 (I1 - 3) - mu ln J + lambda/2 P(ln J)^2,
P the projection on linear functions in each cell (Q2/P1: a mixed pressure, eliminated); contact by
augmented Lagrange at two points an edge, so that no penalty is left in the answer; SuperLU.
For lambda/2 ln(J)^2 this is the exact stationary value over a discontinuous linear pressure.
Friction: what sticks does not move against the sphere within a step, by the same multipliers, up to
friction times the pressure; of first order in the steps.

A flat needs cells at its rim that resolve its edge (`rim_lines`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from deltact_fab.common.aliases import Field

_P3 = np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
_W3 = np.array([5.0, 8.0, 5.0]) / 9
_P2 = np.array([-1.0, 1.0]) / np.sqrt(3)


def _lagrange(x: Field) -> tuple[Field, Field]:
    """Values and slopes (q, 3) of the quadratic shape functions at -1, 0, 1."""
    value = np.stack([x * (x - 1) / 2, 1 - x**2, x * (x + 1) / 2], axis=1)
    slope = np.stack([x - 0.5, -2 * x, x + 0.5], axis=1)
    return value, slope


def graded(
    length: float, size: float, fine: float, growth: float = 1.3, most: float = 8.0
) -> Field:
    """Lines from 0 to length: cells of `size` up to `fine`, growing beyond to `most` times that."""
    steps = [fine / round(fine / size)] * round(fine / size)
    step = size
    rest: list[float] = []
    while sum(rest) < length - fine:
        step = min(step * growth, most * size)
        rest.append(step)
    scale = (length - fine) / sum(rest)
    return np.concatenate([[0.0], np.cumsum(steps + [s * scale for s in rest])])


class Tool(Protocol):
    """A rigid body, by its distance from points (e, q, 2), r and z above its lowest point."""

    def gap(self, points_mm: Field) -> tuple[Field, Field, Field]:
        """Distance and curvature 1/(radius + distance) (e, q), unit normal (e, q, 2)."""


@dataclass(frozen=True)
class Ball:
    radius_mm: float

    def gap(self, points_mm: Field) -> tuple[Field, Field, Field]:
        from_centre = points_mm - np.array([0.0, self.radius_mm])
        size = np.linalg.norm(from_centre, axis=-1)
        return size - self.radius_mm, 1 / size, from_centre / size[..., None]


@dataclass(frozen=True)
class Flat:
    """A round punch with a rounded edge."""

    radius_mm: float
    edge_mm: float

    def gap(self, points_mm: Field) -> tuple[Field, Field, Field]:
        foot_mm = self.radius_mm - self.edge_mm
        size, curvature, normal = Ball(self.edge_mm).gap(points_mm - np.array([foot_mm, 0.0]))
        below = points_mm[..., 0] < foot_mm
        flat = np.where(below[..., None], np.array([0.0, -1.0]), normal)
        distance = np.where(below, -points_mm[..., 1], size)
        return distance, np.where(below, 0.0, curvature), flat


@dataclass
class Rub:
    """Friction of one step at the edges' points. at (e, q, 2): from the tool's lowest point at its
    start; along (e, q, 2): tangent there; shear, bound (e, q): multipliers and their limit, MPa."""

    at: Field
    along: Field
    shear: Field
    bound: Field

    def trial(self, at: Field, k: float) -> Field:
        return self.shear + k * ((at - self.at) * self.along).sum(axis=2)


@dataclass(frozen=True)
class Pressed:
    """depth_mm; force_n: on the tool, upwards; r_mm, u_r_mm, u_z_mm: at the face's nodes;
    penetration_mm: deepest at the contact points; iterations: Newton's, of this depth;
    rim_mm: where the last point under pressure and the first without have come to."""

    depth_mm: float
    force_n: float
    r_mm: Field
    u_r_mm: Field
    u_z_mm: Field
    penetration_mm: float
    iterations: int
    rim_mm: tuple[float, float]

    def radial_mm(self, r_mm: Field) -> Field:
        """u_r at radii on the face at rest, by the cells' own quadratics."""
        e = np.clip(np.searchsorted(self.r_mm[2::2], r_mm), 0, len(self.r_mm) // 2 - 1)
        low, high = self.r_mm[2 * e], self.r_mm[2 * e + 2]
        shape, _ = _lagrange(2 * (r_mm - low) / (high - low) - 1)
        return (shape * self.u_r_mm[2 * e[:, None] + np.arange(3)]).sum(axis=1)


class Cylinder:
    """Radius x thickness, z from -thickness (bonded) to 0 (touched), free side.

    r_mm, z_mm: lines of the cells, increasing; z_mm from -thickness to 0.
    """

    def __init__(self, r_mm: Field, z_mm: Field, modulus_mpa: float, poisson: float) -> None:
        self.mu = modulus_mpa / (2 * (1 + poisson))
        self.lam = modulus_mpa * poisson / ((1 + poisson) * (1 - 2 * poisson))
        r, z = _with_middles(r_mm), _with_middles(z_mm)
        nr, nz = len(r), len(z)
        self.nodes = np.stack([np.repeat(r, nz), np.tile(z, nr)], axis=1)
        i, j = (c.ravel() for c in np.meshgrid(*(np.arange(0, n - 1, 2) for n in (nr, nz))))
        a, b = (c.ravel() for c in np.meshgrid(np.arange(3), np.arange(3), indexing="ij"))
        self.cells = (i[:, None] + a) * nz + j[:, None] + b
        self.dofs = (2 * self.cells[..., None] + np.arange(2)).reshape(-1, 18)
        self.top = np.arange(nr) * nz + nz - 1
        self.edges = self.top[np.arange(0, nr - 1, 2)[:, None] + np.arange(3)]
        held = np.zeros((nr * nz, 2), dtype=bool)
        held[self.nodes[:, 1] == z[0]] = True
        held[self.nodes[:, 0] == 0, 0] = True
        self.free = np.flatnonzero(~held.ravel())
        self._shapes()
        at_rest = self.bulk(np.zeros_like(self.nodes))[2]
        assert at_rest is not None
        self.at_rest = at_rest
        value, slope = _lagrange(_P2)
        x = self.nodes[self.edges, 0]
        self.edge_value = value
        self.edge_w = 2 * np.pi * (x @ value.T) * (x @ slope.T)  # resting area
        # Rounding of what cancels at rest, in forces and in the energy.
        self.noise_n = 1e-12 * self.mu * float(self.edge_w.sum())
        self.noise_nmm = 1e-14 * self.mu * float(self.w.sum())

    def _shapes(self) -> None:
        value, slope = _lagrange(_P3)
        n = np.einsum("pa,qb->pqab", value, value).reshape(9, 9)
        dxi = np.einsum("pa,qb->pqab", slope, value).reshape(9, 9)
        deta = np.einsum("pa,qb->pqab", value, slope).reshape(9, 9)
        x = self.nodes[self.cells]
        # Cells are rectangles at rest.
        jr, jz = x[..., 0] @ dxi.T, x[..., 1] @ deta.T
        radius = x[..., 0] @ n.T
        self.w = 2 * np.pi * radius * jr * jz * np.outer(_W3, _W3).ravel()
        m = len(x)
        # Rows of F: rr, rz, zr, zz, hoop; columns: (node, direction).
        b = np.zeros((m, 9, 5, 9, 2))
        b[:, :, 0, :, 0] = b[:, :, 2, :, 1] = dxi / jr[..., None]
        b[:, :, 1, :, 0] = b[:, :, 3, :, 1] = deta / jz[..., None]
        b[:, :, 4, :, 0] = n / radius[..., None]
        self.b = b.reshape(m, 9, 5, 18)
        xi, eta = np.repeat(_P3, 3), np.tile(_P3, 3)
        linear = np.broadcast_to(np.stack([np.ones(9), xi, eta], axis=1), (m, 9, 3))
        # An orthonormal basis in the cell's own weights makes the projection a sum of squares.
        root = np.sqrt(self.w)[..., None]
        self.phi = np.linalg.qr(root * linear)[0] / root

    def bulk(self, u: Field, tangent: bool = True) -> tuple[float, Field, Field | None]:
        """Energy (inf if turned inside out), cell forces (m, 18) and stiffnesses (m, 18, 18)."""
        f = np.matmul(self.b, u.ravel()[self.dofs][:, None, :, None])[..., 0]
        f = f + np.array([1.0, 0.0, 0.0, 1.0, 1.0])
        det = f[..., 0] * f[..., 3] - f[..., 1] * f[..., 2]
        if not (det.min() > 0 and f[..., 4].min() > 0):
            return np.inf, f, None
        log = np.log(det * f[..., 4])
        theta = np.einsum("mq,mqk,mq->mk", self.w, self.phi, log)
        local = self.mu * (((f**2).sum(axis=2) - 3) / 2 - log)
        energy = float((self.w * local).sum() + self.lam / 2 * (theta**2).sum())
        c = np.empty_like(f)  # derivative of ln J
        c[..., 0], c[..., 1] = f[..., 3] / det, -f[..., 2] / det
        c[..., 2], c[..., 3] = -f[..., 1] / det, f[..., 0] / det
        c[..., 4] = 1 / f[..., 4]
        pressure = self.lam * np.einsum("mqk,mk->mq", self.phi, theta) - self.mu
        stress = self.w[..., None] * (self.mu * f + pressure[..., None] * c)
        force = np.einsum("mqi,mqij->mj", stress, self.b, optimize=True)
        if not tangent:
            return energy, force, None
        place = ((0, 0), (0, 1), (1, 0), (1, 1))
        second = np.zeros((*f.shape, 5))  # of ln J: -c_il c_kj
        for s, (i, j) in enumerate(place):
            for t, (k, n) in enumerate(place):
                second[..., s, t] = -c[..., 2 * i + n] * c[..., 2 * k + j]
        second[..., 4, 4] = -(c[..., 4] ** 2)
        d = (self.w * pressure)[..., None, None] * second
        d = d + (self.w * self.mu)[..., None, None] * np.eye(5)
        m = len(f)
        k = np.matmul(self.b.reshape(m, 45, 18).transpose(0, 2, 1),
                      np.matmul(d, self.b).reshape(m, 45, 18))  # fmt: skip
        cb = np.matmul(c[:, :, None, :], self.b)[:, :, 0, :]
        whole = np.matmul(np.swapaxes(self.w[..., None] * self.phi, 1, 2), cb)
        return energy, force, k + self.lam * np.matmul(np.swapaxes(whole, 1, 2), whole)

    def away(self, u: Field, depth: float) -> Field:
        """Edge points (e, q, 2) from the tool's lowest point."""
        at = np.einsum("qa,eai->eqi", self.edge_value, (self.nodes + u)[self.edges])
        return at + np.array([0.0, depth])

    def contact(
        self, u: Field, tool: Tool, depth: float, multiplier: Field, k: float,
        rub: Rub | None = None,
    ) -> tuple[float, Field, Field]:  # fmt: skip
        """Augmented potential, edge forces (e, 6) and stiffnesses (e, 6, 6)."""
        g, curvature, n = tool.gap(self.away(u, depth))
        p = np.maximum(multiplier - k * g, 0.0)
        energy = float((self.edge_w * (p**2 - multiplier**2)).sum() / (2 * k))
        pull = -p[..., None] * n
        nn = n[..., :, None] * n[..., None, :]
        bend = (np.eye(2) - nn) * curvature[..., None, None]
        block = (k * (p > 0))[..., None, None] * nn - p[..., None, None] * bend
        if rub is not None:
            y, b, t = rub.trial(self.away(u, depth), k), rub.bound, rub.along
            held = np.abs(y) <= b
            huber = np.where(held, y**2 / 2, b * (np.abs(y) - b / 2))
            energy += float((self.edge_w * huber).sum()) / k
            pull = pull + np.clip(y, -b, b)[..., None] * t
            block += (k * held)[..., None, None] * t[..., :, None] * t[..., None, :]
        force = np.einsum("eq,qa,eqi->eai", self.edge_w, self.edge_value, pull)
        block *= self.edge_w[..., None, None]
        v = self.edge_value
        ke = np.einsum("qa,qb,eqij->eaibj", v, v, block, optimize=True)
        return energy, force.reshape(-1, 6), ke.reshape(-1, 6, 6)

    def press(
        self, tool: Tool, depths_mm: list[float], step_mm: float | None = None,
        penalty: float | None = None, closed_mm: float = 1e-5, friction: float = 0.0,
    ) -> list[Pressed]:  # fmt: skip
        """Solve at increasing depths; closed_mm: what points under pressure may overlap or gape.

        step_mm (if not given 0.6 cell, at most 0.25) and penalty in MPa/mm (50 mu / cell) change
        the work, not the answer. RuntimeError where it does not converge.
        """
        cell = float(np.ptp(self.nodes[self.edges][..., 0], axis=1).min())
        penalty = 50 * self.mu / cell if penalty is None else penalty
        step_mm = min(0.25, 0.6 * cell) if step_mm is None else step_mm
        u = last = np.zeros_like(self.nodes)
        multiplier, shear, rub = np.zeros(self.edge_w.shape), np.zeros(self.edge_w.shape), None
        out, depth = [], 0.0
        for goal in depths_mm:
            n, before, count = max(1, round((goal - depth) / step_mm)), depth, 0
            for i in range(1, n + 1):
                old, depth = depth, before + (goal - before) * i / n
                if friction > 0:
                    normal = tool.gap(self.away(u, old))[2]
                    along = np.stack([-normal[..., 1], normal[..., 0]], axis=-1)
                    rub = Rub(self.away(u, old), along, shear, friction * multiplier)
                # A start that overlaps by a whole step crushes the cells under the face.
                ahead = 2 * u - last
                u, last = (ahead if np.isfinite(self.bulk(ahead, False)[0]) else u), u
                # Only the depths asked for need the constraint closed.
                for _ in range(60 if i == n else 4 if friction > 0 else 1):
                    u, took = self._newton(u, tool, depth, multiplier, penalty, rub)
                    count += took
                    g = tool.gap(self.away(u, depth))[0]
                    new = np.maximum(multiplier - penalty * g, 0.0)
                    change = float(np.abs(new - multiplier).max()) / penalty
                    multiplier = new
                    if rub is not None:
                        y = rub.trial(self.away(u, depth), penalty)
                        rub.bound = friction * multiplier
                        shear = np.clip(y, -rub.bound, rub.bound)
                        change = max(change, float(np.abs(shear - rub.shear).max()) / penalty)
                        rub.shear = shear
                    if change < closed_mm:
                        break
            if change > closed_mm:
                raise RuntimeError(f"twin: contact still open by {change:.1e} mm at {goal} mm")
            g, _, normal = tool.gap(self.away(u, goal))
            force = -float((self.edge_w * multiplier * normal[..., 1]).sum())
            if rub is not None:
                force += float((self.edge_w * rub.shear * rub.along[..., 1]).sum())
            face = u[self.top]
            overlap = max(0.0, -float(g.min()))
            r = self.nodes[self.top, 0]
            at = self.away(u, goal)[..., 0].ravel()
            outermost = int(np.flatnonzero(multiplier.ravel() > 0)[-1])
            rim = float(at[outermost]), float(at[outermost + 1])
            out.append(Pressed(goal, force, r, face[:, 0], face[:, 1], overlap, count, rim))
        return out

    def linear_force_n(self, radius_mm: float, depth_mm: float) -> float:
        """The same sphere at small strain: stiffness at rest, every point held against the sphere
        above where it rested. Contact points in or out by turns until none changes."""
        rows, columns = np.repeat(self.dofs, 18, axis=1), np.tile(self.dofs, 18)
        entries = (self.at_rest.ravel(), (rows.ravel(), columns.ravel()))
        stiffness = sp.csc_matrix(entries, shape=(self.nodes.size, self.nodes.size))
        r = self.nodes[self.edges, 0] @ self.edge_value.T
        edge, point = np.nonzero(r < min(1.3 * np.sqrt(2 * radius_mm * depth_mm), radius_mm))
        drop = depth_mm - radius_mm + np.sqrt(radius_mm**2 - r[edge, point] ** 2)
        load = np.zeros((self.nodes.size, len(edge)))
        for a in range(3):
            load[2 * self.edges[edge, a] + 1, np.arange(len(edge))] = self.edge_value[point, a]
        load = load[self.free]
        soft = load.T @ spla.splu(stiffness[self.free][:, self.free]).solve(load)
        on = drop > 0
        for _ in range(100):
            force = np.zeros(len(edge))
            force[on] = np.linalg.solve(soft[np.ix_(on, on)], drop[on])
            now = np.where(on, force > 0, soft @ force < drop)
            if (now == on).all():
                return float(force.sum())
            on = now
        raise RuntimeError(f"twin: the contact at small strain swings at {depth_mm} mm")

    def _newton(
        self, u: Field, tool: Tool, depth: float, multiplier: Field, k: float, rub: Rub | None
    ) -> tuple[Field, int]:
        edge_dofs = (2 * self.edges[..., None] + np.arange(2)).reshape(-1, 6)
        rows = np.concatenate([np.repeat(d, d.shape[1], axis=1).ravel()
                               for d in (self.dofs, edge_dofs)])  # fmt: skip
        columns = np.concatenate([np.tile(d, d.shape[1]).ravel() for d in (self.dofs, edge_dofs)])
        size = self.nodes.size
        for count in range(40):
            energy, force, ke = self.bulk(u)
            more, push, kc = self.contact(u, tool, depth, multiplier, k, rub)
            assert ke is not None
            total = np.bincount(self.dofs.ravel(), force.ravel(), size)
            pushed = np.bincount(edge_dofs.ravel(), push.ravel(), size)
            residual = (total + pushed)[self.free]
            balanced_n = max(1e-9 * float(np.linalg.norm(pushed)), self.noise_n)
            if float(np.linalg.norm(residual)) <= balanced_n:
                return u, count
            # Buckled cells make the tangent indefinite; the tangent at rest, added, cures it.
            for shift in (0.0, 0.03, 0.3, 3.0):
                data = np.concatenate([(ke + shift * self.at_rest).ravel(), kc.ravel()])
                matrix = sp.csc_matrix((data, (rows, columns)), shape=(size, size))
                matrix = matrix[self.free][:, self.free]
                options = {"SymmetricMode": True}
                factor = spla.splu(matrix, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
                step = np.zeros(size)
                step[self.free] = -factor.solve(residual)
                slope, length = float(residual @ step[self.free]), 1.0
                if slope < 0:
                    break
            while length > 1e-6:
                trial = u + length * step.reshape(-1, 2)
                now = self.bulk(trial, False)[0]
                now += self.contact(trial, tool, depth, multiplier, k, rub)[0]
                # The last steps change the energy by less than its rounding.
                noise = 1e-10 * abs(energy) + self.noise_nmm
                if now <= energy + more + 1e-4 * length * slope + noise:
                    break
                length /= 2
            else:
                raise RuntimeError(f"twin: no shorter step lowers the energy at {depth} mm")
            u = trial
        raise RuntimeError(f"twin: Newton did not converge at {depth} mm")


def _with_middles(lines: Field) -> Field:
    out = np.empty(2 * len(lines) - 1)
    out[::2], out[1::2] = lines, (lines[1:] + lines[:-1]) / 2
    return out


def rim_lines(size: float, rim: float, length: float, growth: float = 1.3) -> Field:
    """Lines from 0 to length whose cells are of `size` at the rim and grow away from it."""
    inner = rim - graded(rim, size, size, growth)[::-1]
    return np.concatenate([inner, rim + graded(length - rim, size, size, growth, 40.0)[1:]])


def cylinder(
    size_mm: float, radius_mm: float, thickness_mm: float, modulus_mpa: float = 0.56,
    poisson: float = 0.49,
) -> Cylinder:  # fmt: skip
    """Cells of size_mm where the sphere presses, larger beyond r = 9 mm and 4 mm below the face."""
    r = graded(radius_mm, size_mm, 9.0)
    z = -graded(thickness_mm, size_mm, 4.0)[::-1]
    return Cylinder(r, z, modulus_mpa, poisson)
