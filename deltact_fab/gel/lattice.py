"""The common lattice over the resting face: what its nodes hold, and how a field is summed.

Displacements are sampled at the nodes (`hermite`). Tractions, which jump, are not: what a level has
on parts of the face, each with one value, goes to the nodes by areas (`means`). A node holds the
mean around it, weighted with its hat: 1 at the node, 0 from the next ones on. Hats are nowhere
negative, add up to 1 and reproduce x and y, so the trapezoids' sum over the face gives the parts'
own force, and on the resting face their moment.
"""

from __future__ import annotations

import numpy as np

from ..aliases import Field


def means(edges_mm: Field, at_mm: Field) -> Field:
    """Matrix (nodes, parts) from values on the parts between edges to the nodes' means, one way.

    edges_mm (parts + 1,), at_mm (nodes,): rising. What lies beyond the last node is counted to it.
    """
    shares = np.diff(_hats_up_to(edges_mm, at_mm), axis=0).T
    return np.ascontiguousarray(shares / _areas(at_mm)[:, None])


def _areas(at: Field) -> Field:
    """Integrals of the nodes' hats: the trapezoids' weights."""
    half = np.diff(at) / 2
    return np.append(half, 0.0) + np.append(0.0, half)


def _hats_up_to(x: Field, at: Field) -> Field:
    """(points, nodes): integrals of the hats from the first node on; outer ones go on as 1."""
    n, width = len(at), np.diff(at)
    i = np.clip(np.searchsorted(at, x, side="right") - 1, 0, n - 2)
    rows, s = np.arange(len(x)), np.clip((x - at[i]) / width[i], 0.0, 1.0)
    passed = (np.arange(n - 1) < i[:, None]) * (width / 2)
    found = np.zeros((len(x), n))
    found[:, :-1] += passed
    found[:, 1:] += passed
    found[rows, i] += width[i] * (s - s**2 / 2)
    found[rows, i + 1] += width[i] * s**2 / 2
    found[:, 0] += np.minimum(x - at[0], 0.0)
    found[:, -1] += np.maximum(x - at[-1], 0.0)
    return found


def hermite(knots: Field, at: Field) -> Field:
    """Matrix (points, knots) of the local cubic; outside of the knots the last cubic goes on.

    Slopes at the knots are those of parabolas through three neighbours.
    """
    from scipy.interpolate import CubicHermiteSpline

    values = np.eye(len(knots))
    slopes = np.gradient(values, knots, axis=0, edge_order=2 if len(knots) > 2 else 1)
    return np.asarray(CubicHermiteSpline(knots, values, slopes)(at))
