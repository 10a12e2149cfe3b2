"""The lattice on which displacements of the face are stored, and what lies between its nodes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

Array = NDArray[Any]


@dataclass(frozen=True)
class SurfaceLattice:
    """A regular lattice of points on the resting face, on which displacements are stored.

    x0_mm, y0_mm: first node; spacing_mm: between nodes; nx, ny: their number.
    """

    x0_mm: float
    y0_mm: float
    spacing_mm: float
    nx: int
    ny: int

    def as_dict(self) -> dict[str, Any]:
        """Plain data for the record."""
        return asdict(self)


@dataclass(frozen=True)
class LatticeSampler:
    """Cubic B-spline interpolation from a lattice to the tensor grid xs x ys, as two matrices.

    The drawing camera and the stored truth both go through it, so they agree to rounding.
    """

    along_x: NDArray[np.float64]  # (len(xs), nx)
    along_y: NDArray[np.float64]  # (len(ys), ny)

    @classmethod
    def make(cls, lattice: SurfaceLattice, xs_mm: Array, ys_mm: Array) -> LatticeSampler:
        """Build the matrices. Raises InputError when a point lies outside the lattice."""
        return cls(
            _spline_matrix(lattice.x0_mm, lattice.spacing_mm, lattice.nx, xs_mm),
            _spline_matrix(lattice.y0_mm, lattice.spacing_mm, lattice.ny, ys_mm),
        )

    def __call__(self, values: Array) -> NDArray[np.float64]:
        """(ny, nx, c) on the lattice to (len(ys), len(xs), c)."""
        columns = [self.along_y @ values[..., c] @ self.along_x.T for c in range(values.shape[-1])]
        return np.stack(columns, axis=-1)

    def at_points(self, values: Array) -> NDArray[np.float64]:
        """(ny, nx, c) on the lattice to (n, c) at the points (xs[i], ys[i]) taken in pairs."""
        return np.einsum("py,yxc,px->pc", self.along_y, values, self.along_x, optimize=True)


def _spline_matrix(x0: float, step: float, n: int, points: Array) -> NDArray[np.float64]:
    """Matrix (len(points), n) of cubic B-spline interpolation with not-a-knot ends."""
    from scipy.interpolate import make_interp_spline

    nodes = x0 + step * np.arange(n)
    if np.min(points) < nodes[0] - 1e-9 or np.max(points) > nodes[-1] + 1e-9:
        raise InputError(
            f"points from {np.min(points):.3f} to {np.max(points):.3f} mm leave the lattice "
            f"{nodes[0]:.3f} to {nodes[-1]:.3f} mm"
        )
    return np.asarray(make_interp_spline(nodes, np.eye(n), k=3)(points))
