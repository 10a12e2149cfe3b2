"""The loop over cells in machine code; the same numbers as `BulkAssembly` in numpy.

Importing it needs numba, which the extra `fast` brings.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .assembly import BulkAssembly

Field = NDArray[np.float64]


def evaluate(
    bulk: BulkAssembly, displacement_mm: Field, tangent: bool
) -> tuple[float, Field | None, Field | None, float]:
    """The four values of `assembly.Bulk`."""
    force = np.zeros_like(displacement_mm)
    data = np.zeros(bulk.pattern.entries + 1 if tangent else 0)
    energy, least = _loop(
        np.ascontiguousarray(displacement_mm), bulk.mesh.cells, bulk.gradients_per_mm,
        bulk.weights_mm3, bulk.pattern.slots, bulk.law.mu_mpa, bulk.law.lambda_mpa,
        tangent, force, data,
    )  # fmt: skip
    if not least > 0:
        return np.inf, None, None, least
    return energy, force, data[:-1] if tangent else None, least


@numba.njit(cache=True, fastmath={"contract", "reassoc", "nsz"})
def _loop(
    displacement: Any, cells: Any, gradients: Any, weights: Any, slots: Any, mu: float,
    lam: float, tangent: bool, force: Any, data: Any,
) -> tuple[float, float]:  # fmt: skip
    m = cells.shape[0]
    energy, least = 0.0, np.inf
    u, g = np.empty((8, 3)), np.empty((8, 24))
    f, c = np.empty((8, 3, 3)), np.empty((3, 3))
    jac = np.empty(8)
    inv = np.empty((8, 3, 3))
    outer, cross, whole = np.empty((24, 24)), np.empty((24, 24)), np.empty(24)
    lap = np.empty((8, 8))
    for e in range(m):
        grad = gradients[e]
        for a in range(8):
            for i in range(3):
                u[a, i] = displacement[cells[e, a], i]
        volume, dilated = 0.0, 0.0
        for q in range(8):
            for i in range(3):
                for j in range(3):
                    s = 1.0 if i == j else 0.0
                    for a in range(8):
                        s += u[a, i] * grad[a, 3 * q + j]
                    f[q, i, j] = s
            fq = f[q]
            for i in range(3):
                for j in range(3):
                    # Cofactor of F_ij, in place of the inverse's transpose.
                    c[i, j] = (
                        fq[(i + 1) % 3, (j + 1) % 3] * fq[(i + 2) % 3, (j + 2) % 3]
                        - fq[(i + 1) % 3, (j + 2) % 3] * fq[(i + 2) % 3, (j + 1) % 3]
                    )
            det = fq[0, 0] * c[0, 0] + fq[0, 1] * c[0, 1] + fq[0, 2] * c[0, 2]
            least = min(least, det)
            if not det > 0.0:
                return np.inf, least
            jac[q] = det
            for i in range(3):
                for j in range(3):
                    inv[q, i, j] = c[i, j] / det
            volume += weights[e, q]
            dilated += weights[e, q] * det
        jbar = dilated / volume
        log = np.log(jbar)
        u1 = lam * log / jbar
        u2 = lam * (1 - log) / jbar**2
        energy += volume * lam / 2 * log**2
        if tangent:
            outer[:] = 0.0
            cross[:] = 0.0
            whole[:] = 0.0
            lap[:] = 0.0
        for q in range(8):
            w = weights[e, q]
            pj = u1 * jac[q]
            square = 0.0
            for i in range(3):
                for j in range(3):
                    square += f[q, i, j] ** 2
            energy += w * mu * ((square - 3) / 2 - np.log(jac[q]))
            for a in range(8):
                for i in range(3):
                    s, t = 0.0, 0.0
                    for j in range(3):
                        s += inv[q, i, j] * grad[a, 3 * q + j]
                        t += f[q, i, j] * grad[a, 3 * q + j]
                    g[q, 3 * a + i] = s
                    force[cells[e, a], i] += w * (mu * t + (pj - mu) * s)
            if tangent:
                gq = g[q]
                c1, c2, c3 = w * pj, w * (mu - pj), w * jac[q]
                for i in range(24):
                    g1, g2 = c1 * gq[i], c2 * gq[i]
                    for j in range(24):
                        outer[i, j] += g1 * gq[j]
                        cross[i, j] += g2 * gq[j]
                    whole[i] += c3 * gq[i]
                for a in range(8):
                    for b in range(8):
                        s = 0.0
                        for j in range(3):
                            s += grad[a, 3 * q + j] * grad[b, 3 * q + j]
                        lap[a, b] += w * mu * s
        if tangent:
            k = 0
            for a in range(8):
                for i in range(3):
                    for b in range(a, 8):
                        first = i if b == a else 0
                        for j in range(first, 3):
                            s = (
                                outer[3 * a + i, 3 * b + j]
                                + cross[3 * a + j, 3 * b + i]
                                + u2 / volume * whole[3 * a + i] * whole[3 * b + j]
                            )
                            if i == j:
                                s += lap[a, b]
                            data[slots[e, k]] += s
                            k += 1
    return energy, least
