"""A block under a rigid ball, pressed and dragged, solved on its own: 3D, finite strain, friction.

Shares no line with `deltact_fab.physics.gel.finite`. Bricks of 27 nodes with a linear pressure in
each (Q2/P1, the pressure eliminated); energy
    mu/2 (I1 - 3) (1 + stiffening (I1 - 3)) - mu ln J + lambda/2 P(ln J)^2,
P the projection on linear functions of a brick. The ball is met at 2 x 2 points a face: multipliers
with a penalty that is closed by augmentation, and Coulomb's law by return mapping on them, its
tangent whole and not symmetric. What a point that is touched within a step has rubbed before that
step's end is left out: of first order in the steps.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from deltact_fab.common.aliases import Field, Point

P3, W3 = np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0]), np.array([5.0, 8.0, 5.0]) / 9
P2 = np.array([-1.0, 1.0]) / np.sqrt(3)
CLOSED_MM = 3e-4  # what points under pressure may overlap, gape or creep
BASE_MM = 2e-4  # how far the base may be from where the force puts it
SETTLED = 3e-6  # residual over the contact's force
HALVINGS = 4  # of a step that does not converge
ROUNDS, MOST = 12, 18  # augmentations of a step, iterations of Newton's method


@dataclass(frozen=True)
class Gel:
    """A block bonded at its base, modulus for small strain; base_mm_n: how it yields under the
    normal force, the middle of it by all of that and its rim by half."""

    size_mm: tuple[float, float, float] = (36.0, 34.0, 12.0)
    modulus_mpa: float = 0.56
    poisson: float = 0.49
    stiffening: float = 0.0
    base_mm_n: float = 0.0


@dataclass(frozen=True)
class Pose:
    """The ball's lowest point, depth positive into the gel."""

    tip_mm: Point
    keep: bool = True


@dataclass(frozen=True, eq=False)
class Solved:
    """One pose. force_n, torque_nmm: on the gel, about the centre of its resting face. At the
    contact's points (n,): at_mm (n, 2) and rest_mm2 on the resting face, traction_mpa (n, 3) per
    that area, area_mm2 as it lies, slips. nodes_mm (ny, nx, 3): how the face moved, at the mesh's
    own nodes axes_mm."""

    tip_mm: Point
    force_n: Field
    torque_nmm: Field
    at_mm: Field
    traction_mpa: Field
    rest_mm2: Field
    area_mm2: Field
    slips: NDArray[np.bool_]
    nodes_mm: Field
    axes_mm: tuple[Field, Field]

    def face_mm(self, x_mm: Field, y_mm: Field) -> Field:
        """How the face moved (ny, nx, 3), by the mesh's own quadratics."""
        wx, wy = (_at(axis, at) for axis, at in zip(self.axes_mm, (x_mm, y_mm), strict=True))
        return np.asarray(np.einsum("yj,jik,xi->yxk", wy, self.nodes_mm, wx))


def graded(low: float, high: float, fine: tuple[float, float], size: float, growth: float) -> Field:
    """Lines from low to high: even ones of about `size` within fine, growing away from it."""
    a, b = max(low, fine[0]), min(high, fine[1])
    inner = np.linspace(a, b, max(1, round((b - a) / size)) + 1)

    def away(length: float) -> list[float]:
        if length < 1e-9:
            return []
        step = size
        steps: list[float] = []
        while sum(steps) < length - 1e-9:
            step *= growth
            steps.append(step)
        if len(steps) > 1 and sum(steps) - length > steps[-1] / 2:
            steps.pop()
        return list(np.cumsum(steps) * (length / sum(steps)))

    return np.array(
        [*(a - s for s in reversed(away(a - low))), *inner, *(b + s for s in away(high - b))]
    )


def _shape(x: Field) -> tuple[Field, Field]:
    value = np.stack([x * (x - 1) / 2, 1 - x**2, x * (x + 1) / 2], axis=1)
    return value, np.stack([x - 0.5, -2 * x, x + 0.5], axis=1)


def _at(axis: Field, x: Field) -> Field:
    """Matrix (x, nodes) of values along a line of three-node cells."""
    e = np.clip(np.searchsorted(axis[2::2], x), 0, len(axis) // 2 - 1)
    low, high = axis[2 * e], axis[2 * e + 2]
    t = 2 * (x - low) / (high - low) - 1
    found = np.zeros((len(x), len(axis)))
    rows = np.arange(len(x))
    for k, value in enumerate(_shape(t)[0].T):
        found[rows, 2 * e + k] += value
    return found


class Block:
    """The mesh of a gel and its stiffness. lines: of the bricks along x, y, z; z from -thickness to
    0. mirror: the block is cut at y = 0, which nothing crosses."""

    def __init__(self, gel: Gel, lines: Sequence[Field], mirror: bool = False) -> None:
        self.gel, self.mirror = gel, mirror
        self.mu = gel.modulus_mpa / (2 * (1 + gel.poisson))
        self.lam = gel.modulus_mpa * gel.poisson / ((1 + gel.poisson) * (1 - 2 * gel.poisson))
        self.axes = [_with_middles(np.asarray(line)) for line in lines]
        nx, ny, nz = (len(axis) for axis in self.axes)
        z, y, x = np.meshgrid(*reversed(self.axes), indexing="ij")
        self.nodes = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
        k, j, i = (c.ravel() for c in np.meshgrid(
            *(np.arange(0, n - 1, 2) for n in (nz, ny, nx)), indexing="ij"))  # fmt: skip
        steps = np.array(list(itertools.product(range(3), repeat=3)))  # x, y, z
        self.cells: NDArray[np.int64] = (
            ((k[:, None] + steps[:, 2]) * ny + j[:, None] + steps[:, 1]) * nx
            + i[:, None] + steps[:, 0]
        )  # fmt: skip
        half = np.stack(
            [np.diff(line)[n // 2] / 2 for line, n in zip(lines, (i, j, k), strict=True)], axis=1
        )
        value, slope = _shape(P3)
        parts = [
            np.einsum(
                "pa,qb,rc->pqrabc", *(slope if d == axis else value for d in range(3))
            ).reshape(27, 27)
            for axis in range(3)
        ]
        self.grad = np.stack(parts, axis=-1)[None] / half[:, None, None, :]  # (m, q, node, way)
        self.w = np.einsum("p,q,r->pqr", W3, W3, W3).ravel() * half.prod(axis=1)[:, None]
        at = np.array(list(itertools.product(P3, repeat=3)))
        linear = np.column_stack([np.ones(27), at])
        norm = (np.einsum("p,q,r->pqr", W3, W3, W3).ravel()[:, None] * linear**2).sum(axis=0)
        self.phi = linear / np.sqrt(norm) / np.sqrt(half.prod(axis=1))[:, None, None]
        top = (nz - 1) * nx * ny
        self.face_shape = (ny, nx)
        jj, ii = (
            c.ravel()
            for c in np.meshgrid(*(np.arange(0, n - 1, 2) for n in (ny, nx)), indexing="ij")
        )
        b, a = (c.ravel() for c in np.meshgrid(range(3), range(3), indexing="ij"))
        self.faces: NDArray[np.int64] = top + (jj[:, None] + b) * nx + ii[:, None] + a
        flat, bent = _shape(P2)
        self.face_value = np.einsum("qb,pa->qpba", flat, flat).reshape(4, 9)
        along = (np.einsum("qb,pa->qpba", flat, bent), np.einsum("qb,pa->qpba", bent, flat))
        self.face_slope = np.stack([s.reshape(4, 9) for s in along], axis=-1)
        x0 = self.nodes[self.faces]
        sides = np.einsum("qas,fai->fqsi", self.face_slope, x0)
        self.face_w = np.linalg.norm(np.cross(sides[:, :, 0], sides[:, :, 1]), axis=2)
        self.base = np.flatnonzero(self.nodes[:, 2] == self.nodes[:, 2].min())
        held = np.zeros(self.nodes.shape, bool)
        held[self.base] = True
        if mirror:
            held[self.nodes[:, 1] == 0, 1] = True
        self.free = np.flatnonzero(~held.ravel())
        half_x, half_y = gel.size_mm[0] / 2, gel.size_mm[1] / 2
        bx, by = self.nodes[self.base, 0], self.nodes[self.base, 1]
        self.bend = 0.5 + 0.5 * np.cos(np.pi * bx / (2 * half_x)) * np.cos(
            np.pi * by / (2 * half_y)
        )
        self._pattern()

    def _pattern(self) -> None:
        size = self.nodes.size
        number = np.full(size, -1)
        number[self.free] = np.arange(len(self.free))
        self.cell_dofs = (3 * self.cells[..., None] + np.arange(3)).reshape(len(self.cells), 81)
        self.face_dofs = (3 * self.faces[..., None] + np.arange(3)).reshape(len(self.faces), 27)
        rows, columns = [], []
        for dofs in (self.cell_dofs, self.face_dofs):
            local = number[dofs]
            rows.append(np.repeat(local, dofs.shape[1], axis=1).ravel())
            columns.append(np.tile(local, dofs.shape[1]).ravel())
        row, column = np.concatenate(rows), np.concatenate(columns)
        self.kept = np.flatnonzero((row >= 0) & (column >= 0))
        n = len(self.free)
        code = row[self.kept].astype(np.int64) * n + column[self.kept]
        unique, self.slot = np.unique(code, return_inverse=True)
        self.indices = (unique % n).astype(np.int32)
        self.indptr = np.searchsorted(unique, np.arange(n + 1, dtype=np.int64) * n).astype(np.int32)

    def matrix(self, cells: Field, faces: Field) -> sp.csr_matrix:
        values = np.concatenate([cells.ravel(), faces.ravel()])[self.kept]
        data = np.bincount(self.slot, values, len(self.indices))
        n = len(self.free)
        return sp.csr_matrix((data, self.indices, self.indptr), shape=(n, n))

    def bulk(self, u: Field, tangent: bool) -> tuple[Field, Field | None] | None:
        """Forces (m, 81) and stiffnesses (m, 81, 81) of the bricks; None if one is inside out."""
        moved = u[self.cells]
        f = np.matmul(np.swapaxes(moved, 1, 2)[:, None], self.grad) + np.eye(3)
        det = np.linalg.det(f)
        if not det.min() > 0:
            return None
        c = np.swapaxes(np.linalg.inv(f), 2, 3)
        log = np.log(det)
        theta = np.einsum("mq,mqk,mq->mk", self.w, self.phi, log)
        stretch = (f**2).sum(axis=(2, 3)) - 3
        s = self.gel.stiffening
        stiff = self.mu * (1 + 2 * s * stretch)
        pressure = self.lam * np.einsum("mqk,mk->mq", self.phi, theta) - self.mu
        stress = stiff[..., None, None] * f + pressure[..., None, None] * c
        weighted = self.w[..., None, None] * stress
        m = len(moved)
        force = np.einsum("mqij,mqaj->mai", weighted, self.grad, optimize=True).reshape(m, 81)
        if not tangent:
            return force, None
        k = np.empty((m, 27, 3, 27, 3))
        g = self.grad
        left = np.swapaxes(g, 2, 3).reshape(m, 81, 27).swapaxes(1, 2)  # (m, a, (q, j))
        for i in range(3):
            for n in range(i, 3):
                turned = c[:, :, n, :, None] * c[:, :, i, None, :]
                d = -(self.w * pressure)[..., None, None] * turned
                both = f[:, :, i, :, None] * f[:, :, n, None, :]
                d = d + (4 * s * self.mu * self.w)[..., None, None] * both
                if i == n:
                    d = d + (self.w * stiff)[..., None, None] * np.eye(3)
                right = np.matmul(d, np.swapaxes(g, 2, 3)).reshape(m, 81, 27)
                part = np.matmul(left, right)
                k[:, :, i, :, n] = part
                if n > i:
                    k[:, :, n, :, i] = np.swapaxes(part, 1, 2)
        rate = np.einsum("mqij,mqaj->mqai", c, g, optimize=True).reshape(m, 27, 81)
        whole = np.matmul(np.swapaxes(self.w[..., None] * self.phi, 1, 2), rate)
        return force, k.reshape(m, 81, 81) + self.lam * np.matmul(np.swapaxes(whole, 1, 2), whole)


@dataclass
class Touch:
    """What the contact's points remember of the step before: multipliers and place."""

    pressure: Field
    traction: Field  # (f, q, 3) against rubbing, on the ball
    at: Field  # from the ball's centre


class _Contact(NamedTuple):
    """At the points (f, q): pressure, traction against rubbing (.., 3) on the ball, normal of the
    ball, what slips, and the stiffness (.., 3, 3) or None."""

    pressure: Field
    traction: Field
    normal: Field
    slips: NDArray[np.bool_]
    stiffness: Field | None

    @property
    def pull(self) -> Field:
        """On the ball, per resting area."""
        return self.traction - self.pressure[..., None] * self.normal


@dataclass
class _State:
    """A solved pose: displacements, contact, how far the base has sunk, and how it came there."""

    u: Field
    touch: Touch
    sunk: float
    rate: Field | None = None
    way: Field | None = None


_Moved = tuple[_State, tuple[Field, _Contact]]


class BallPress:
    """A ball of a radius on a block; friction math.inf sticks for ever."""

    def __init__(self, block: Block, radius_mm: float, friction: float) -> None:
        self.block, self.radius, self.friction = block, radius_mm, friction
        cell = math.sqrt(block.face_w.sum(axis=1).min())
        self.k = 300 * block.mu / cell
        self.kt = 500 * block.mu / cell
        self.solver = Solver()

    def follow(self, poses: Sequence[Pose]) -> Iterator[Solved]:
        """The poses one after the other, a step each, in halves where one does not converge.

        RuntimeError where HALVINGS of them do not help.
        """
        b = self.block
        u = np.zeros_like(b.nodes)
        shape = b.face_w.shape
        last = poses[0].tip_mm
        state = _State(u, Touch(np.zeros(shape), np.zeros((*shape, 3)), self._from(u, last)), 0.0)
        for pose in poses:
            state, done = self._move(state, last, pose.tip_mm, 0)
            last = pose.tip_mm
            if pose.keep:
                yield self._solved(pose.tip_mm, *done)

    def _move(self, state: _State, start: Point, tip: Point, halved: int) -> _Moved:
        try:
            return self._pose(state, start, tip)
        except RuntimeError:
            if halved == HALVINGS:
                raise
        x, y, z = ((p + q) / 2 for p, q in zip(start, tip, strict=True))
        middle = x, y, z
        state, _ = self._move(state, start, middle, halved + 1)
        return self._move(state, middle, tip, halved + 1)

    def _pose(self, state: _State, start: Point, tip: Point) -> _Moved:
        b = self.block
        way = np.array(tip) - np.array(start)
        u, sunk = state.u.copy(), state.sunk
        if state.way is not None and np.allclose(way, state.way, atol=1e-9):
            assert state.rate is not None
            ahead = u + state.rate
            u = u if b.bulk(ahead, False) is None else ahead
        for _ in range(4 if b.gel.base_mm_n else 1):
            u[b.base, 2] = -sunk * b.bend
            u, met = self._step(u, tip, state.touch)
            force_n = -(b.face_w[..., None] * met.pull)[..., 2].sum()
            now = b.gel.base_mm_n * -force_n * (2 if b.mirror else 1)
            if abs(now - sunk) < BASE_MM:
                break
            sunk = now
        touch = Touch(met.pressure, met.traction, self._from(u, tip))
        return _State(u, touch, sunk, u - state.u, way), (u, met)

    def _from(self, u: Field, tip: Point) -> Field:
        b = self.block
        centre = np.array([tip[0], tip[1], self.radius - tip[2]])
        return np.einsum("qa,fai->fqi", b.face_value, (b.nodes + u)[b.faces]) - centre

    def _contact(
        self, u: Field, tip: Point, lam: Field, touch: Touch, base_tau: Field, tangent: bool,
        sticks: bool = False,
    ) -> _Contact:  # fmt: skip
        at = self._from(u, tip)
        far = np.linalg.norm(at, axis=2)
        n = at / far[..., None]
        p = lam - self.k * (far - self.radius)
        held = touch.pressure > 0
        on = held | (p > 0) if sticks else p > 0
        p = np.where(on, p, 0.0)
        y = base_tau / self.kt + np.where(held[..., None], at - touch.at, 0.0)
        along = y - (y * n).sum(axis=2, keepdims=True) * n
        trial = self.kt * along
        size = np.linalg.norm(trial, axis=2)
        rubs = on & held & (self.friction > 0)
        mu = math.inf if sticks else self.friction
        bound = mu * p if math.isfinite(mu) else np.full_like(p, np.inf)
        slips = rubs & (size > bound)
        safe = np.maximum(size, 1e-300)
        scale = np.where(rubs, np.where(slips, bound / safe, 1.0), 0.0)
        tau = scale[..., None] * trial
        if not tangent:
            return _Contact(p, tau, n, slips, None)
        nn = n[..., :, None] * n[..., None, :]
        flat = np.eye(3) - nn
        block = (self.k * on)[..., None, None] * nn - (p / far)[..., None, None] * flat
        dy = (
            flat
            - ((y * n).sum(axis=2) / far)[..., None, None] * flat
            - n[..., :, None] * along[..., None, :] / far[..., None, None]
        )
        m = trial / safe[..., None]
        dtau = (self.kt * scale)[..., None, None] * dy
        ms = m[..., :, None] * m[..., None, :]
        slide = slips[..., None, None] * (
            np.matmul(ms, dtau)
            + (mu * self.k if math.isfinite(mu) else 0.0) * m[..., :, None] * n[..., None, :]
        )
        return _Contact(p, tau, n, slips, block + dtau - slide)

    def _step(self, u: Field, tip: Point, touch: Touch) -> tuple[Field, _Contact]:
        b = self.block
        lam, base_tau = touch.pressure.copy(), touch.traction.copy()
        size = b.nodes.size
        for first in (True, *[False] * (ROUNDS - 1)):
            for i in range(MOST):
                # What was touched goes with the ball at first: from where it was, all would rub.
                sticks = first and i == 0 and self.friction > 0
                bulk = b.bulk(u, True)
                if bulk is None:
                    raise RuntimeError(f"twin: a brick is inside out at {tip}")
                met = self._contact(u, tip, lam, touch, base_tau, True, sticks)
                outer = self._on_nodes(met)
                residual = (np.bincount(b.cell_dofs.ravel(), bulk[0].ravel(), size) + outer)[b.free]
                scale = max(float(np.linalg.norm(outer)), 1e-3 * b.mu)
                if np.linalg.norm(residual) <= SETTLED * scale:
                    break
                assert bulk[1] is not None
                assert met.stiffness is not None
                block = np.einsum(
                    "fq,qa,qb,fqij->faibj",
                    b.face_w, b.face_value, b.face_value, met.stiffness, optimize=True,
                )  # fmt: skip
                matrix = b.matrix(bulk[1], block.reshape(-1, 27, 27))
                flat = np.zeros(size)
                flat[b.free] = -self.solver.solve(matrix, residual)
                step = flat.reshape(-1, 3)
                length = min(1.0, 0.5 / max(np.abs(step).max(), 1e-12))
                if sticks:
                    while length > 1e-2 and b.bulk(u + length * step, False) is None:
                        length /= 2
                else:
                    length = self._length(u, step, length, residual, (tip, lam, touch, base_tau))
                u = u + length * step
            else:
                raise RuntimeError(f"twin: Newton did not converge at {tip}")
            change = float(np.abs(met.pressure - lam).max()) / self.k
            held = (met.pressure > 0) & (touch.pressure > 0) & ~met.slips
            crept = np.linalg.norm(met.traction - base_tau, axis=2)[held]
            creep = float(crept.max(initial=0.0)) / self.kt
            lam = met.pressure
            # What sticks must not creep: its traction is the multiplier of the next round.
            base_tau = np.where((touch.pressure > 0)[..., None], met.traction, 0.0)
            if change < CLOSED_MM and creep < CLOSED_MM:
                return u, met
        raise RuntimeError(f"twin: contact open by {change:.1e} mm, creep {creep:.1e} mm at {tip}")

    def _on_nodes(self, met: _Contact) -> Field:
        b = self.block
        nodal = np.einsum("qa,fqi->fai", b.face_value, b.face_w[..., None] * met.pull)
        return np.asarray(np.bincount(b.face_dofs.ravel(), nodal.ravel(), b.nodes.size), np.float64)

    def _length(
        self, u: Field, step: Field, length: float, residual: Field,
        at: tuple[Point, Field, Touch, Field],
    ) -> float:  # fmt: skip
        """Of a step, halved until it lowers the residual by much, else the best that was tried."""
        b, before = self.block, float(np.linalg.norm(residual))
        best = (math.inf, length)
        while length > 1e-2:
            tried = u + length * step
            bulk = b.bulk(tried, False)
            if bulk is not None:
                whole = self._on_nodes(self._contact(tried, *at, False))
                whole += np.bincount(b.cell_dofs.ravel(), bulk[0].ravel(), b.nodes.size)
                best = min(best, (float(np.linalg.norm(whole[b.free])), length))
                if best[0] < 0.7 * before:
                    break
            length /= 2
        if not math.isfinite(best[0]):
            raise RuntimeError(f"twin: no step at {at[0]}")
        return best[1]

    def _solved(self, tip: Point, u: Field, met: _Contact) -> Solved:
        b = self.block
        on = met.pressure > 0
        x = np.einsum("qa,fai->fqi", b.face_value, (b.nodes + u)[b.faces])
        rest = np.einsum("qa,fai->fqi", b.face_value, b.nodes[b.faces])
        sides = np.einsum("qas,fai->fqsi", b.face_slope, (b.nodes + u)[b.faces])
        area = np.linalg.norm(np.cross(sides[:, :, 0], sides[:, :, 1]), axis=2)
        force = -b.face_w[..., None] * met.pull
        torque, total = np.cross(x, force).sum(axis=(0, 1)), force.sum(axis=(0, 1))
        if b.mirror:
            total, torque = 2 * total * [1, 0, 1], 2 * torque * [0, 1, 0]
        ny, nx = b.face_shape
        return Solved(
            tip, total, torque, rest[on][:, :2], -met.pull[on], b.face_w[on],
            area[on], met.slips[on], u[-ny * nx :].reshape(ny, nx, 3), (b.axes[0], b.axes[1]),
        )  # fmt: skip


class Solver:
    """Pardiso where it is, else SuperLU; the ordering of Pardiso is found once."""

    def __init__(self) -> None:
        try:
            import pypardiso
        except ImportError:
            self._mkl: Any = None
        else:
            self._mkl = pypardiso.PyPardisoSolver(mtype=11)
        self._known = False

    def solve(self, matrix: sp.csr_matrix, right: Field) -> Field:
        if self._mkl is None:
            return spla.splu(matrix.tocsc(), "COLAMD").solve(right)
        self._mkl.set_phase(23 if self._known else 13)
        self._known = True
        return self._mkl._call_pardiso(matrix, right)


def _with_middles(lines: Field) -> Field:
    out = np.empty(2 * len(lines) - 1)
    out[::2], out[1::2] = lines, (lines[1:] + lines[:-1]) / 2
    return out
