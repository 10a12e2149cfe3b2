"""The loop over cells of `BulkAssembly`, in machine code."""

from __future__ import annotations

from typing import Any

import numpy as np

from deltact_fab.common import compile_loop


@compile_loop()
def loop(  # noqa: C901 - one kernel, compiled as a whole
    displacement: Any, cells: Any, gradients: Any, weights: Any, slots: Any, mu: float,
    lam: float, local: float, tangent: bool, force: Any, data: Any, jbars: Any, rates: Any,
    pressures: Any, scale: float, memory: Any,
) -> tuple[float, float]:  # fmt: skip
    m = cells.shape[0]
    energy, least_j = 0.0, np.inf
    u, g = np.empty((8, 3)), np.empty((8, 24))
    f, c = np.empty((8, 3, 3)), np.empty((3, 3))
    jac = np.empty(8)
    inv = np.empty((8, 3, 3))
    outer, cross, rate = np.empty((24, 24)), np.empty((24, 24)), np.empty(24)
    lap = np.empty((8, 8))
    mu *= scale
    fh = np.empty((3, 3))
    remembers = memory.shape[0] > 0
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
            least_j = min(least_j, det)
            if not det > 0.0:
                return np.inf, least_j
            jac[q] = det
            for i in range(3):
                for j in range(3):
                    inv[q, i, j] = c[i, j] / det
            volume += weights[e, q]
            dilated += weights[e, q] * det
        jbar = dilated / volume
        log = np.log(jbar)
        slope = lam * log - local * log**3
        u1 = slope / jbar
        u2 = (lam - 3 * local * log**2 - slope) / jbar**2
        energy += volume * (lam / 2 * log**2 - local / 4 * log**4)
        if tangent:
            outer[:] = 0.0
            cross[:] = 0.0
            lap[:] = 0.0
        rate[:] = 0.0
        # The tangent uses the predicted pressure, so that it does not swing with u1.
        pressure = pressures[e] if pressures.shape[0] > 0 else u1
        for q in range(8):
            w = weights[e, q]
            pj = pressure * jac[q]
            square = 0.0
            for i in range(3):
                for j in range(3):
                    square += f[q, i, j] ** 2
            log_j = np.log(jac[q])
            energy += w * (mu * ((square - 3) / 2 - log_j) + local / 4 * log_j**4)
            local_term = local * log_j**3
            for a in range(8):
                for i in range(3):
                    s, t = 0.0, 0.0
                    for j in range(3):
                        s += inv[q, i, j] * grad[a, 3 * q + j]
                        t += f[q, i, j] * grad[a, 3 * q + j]
                    g[q, 3 * a + i] = s
                    force[cells[e, a], i] += w * (mu * t + (local_term - mu) * s)
                    rate[3 * a + i] += w * jac[q] * s
            if tangent:
                gq = g[q]
                c1, c2 = w * (pj + 3 * local * log_j**2), w * (mu - pj - local_term)
                for i in range(24):
                    g1, g2 = c1 * gq[i], c2 * gq[i]
                    for j in range(24):
                        outer[i, j] += g1 * gq[j]
                        cross[i, j] += g2 * gq[j]
                for a in range(8):
                    for b in range(8):
                        s = 0.0
                        for j in range(3):
                            s += grad[a, 3 * q + j] * grad[b, 3 * q + j]
                        lap[a, b] += w * mu * s
            if remembers:
                h = memory[e, q]
                for i in range(3):
                    fh[i, 0] = f[q, i, 0] * h[0] + f[q, i, 1] * h[3] + f[q, i, 2] * h[4]
                    fh[i, 1] = f[q, i, 0] * h[3] + f[q, i, 1] * h[1] + f[q, i, 2] * h[5]
                    fh[i, 2] = f[q, i, 0] * h[4] + f[q, i, 1] * h[5] + f[q, i, 2] * h[2]
                    for j in range(3):
                        s = -h[i] if i == j else 0.0
                        energy += w * 0.5 * s
                        energy += w * 0.5 * f[q, i, j] * fh[i, j]
                for a in range(8):
                    g0, g1, g2 = grad[a, 3 * q], grad[a, 3 * q + 1], grad[a, 3 * q + 2]
                    for i in range(3):
                        force[cells[e, a], i] += w * (fh[i, 0] * g0 + fh[i, 1] * g1 + fh[i, 2] * g2)
                    if tangent:
                        h0 = h[0] * g0 + h[3] * g1 + h[4] * g2
                        h1 = h[3] * g0 + h[1] * g1 + h[5] * g2
                        h2 = h[4] * g0 + h[5] * g1 + h[2] * g2
                        for b in range(8):
                            lap[a, b] += w * (
                                h0 * grad[b, 3 * q]
                                + h1 * grad[b, 3 * q + 1]
                                + h2 * grad[b, 3 * q + 2]
                            )
        jbars[e] = jbar
        for a in range(8):
            for i in range(3):
                force[cells[e, a], i] += u1 * rate[3 * a + i]
                rates[e, 3 * a + i] = rate[3 * a + i]
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
                                + u2 / volume * rate[3 * a + i] * rate[3 * b + j]
                            )
                            if i == j:
                                s += lap[a, b]
                            data[slots[e, k]] += s
                            k += 1
    return energy, least_j
