"""Additional compliance of a block's face due to its free sides, by finite elements.

Two linear problems share a mesh: the block with free sides, and a periodic slab of the same bricks
that continues beyond the block. The difference of their surface compliances is the effect of the
sides. Near a load both have the same discretisation error, which cancels, so cells far too coarse
for a contact suffice; the contact itself is resolved by the layer.

The slab is the block plus more gel, so the difference is symmetric and positive semidefinite: free
sides only soften the face.

Both problems are condensed to the face, the slab wave by wave, the block in its four symmetry
classes by eliminating one layer of nodes after another from the base up.

Bricks have eight nodes, 2 x 2 x 2 points and one mean dilatation (Nagtegaal, Parks and Rice 1974),
which avoids locking near incompressibility.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.fft
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from deltact_fab.common import Field, InputError, Store, cache_key

from ..shapes.sensor import SkinDimensions

# Corners of a brick as (x, y, z) steps, around the lower face, then the upper; definition.
BRICK_CORNERS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)


class BrickBox(NamedTuple):
    """Bricks along x, y and z, and the sides (x, y, z) of one, mm.

    Nodes go row by row along x, then y, then z from the base up; displacements are (x, y, z).
    """

    bricks: tuple[int, int, int]
    side_mm: tuple[float, float, float]

    @property
    def nodes_a_layer(self) -> int:
        return (self.bricks[0] + 1) * (self.bricks[1] + 1)

    @property
    def nodes(self) -> int:
        return self.nodes_a_layer * (self.bricks[2] + 1)


def stiffness(box: BrickBox, poisson: float, free: NDArray[np.bool_]) -> sp.csr_matrix:
    """Stiffness (upper triangle) of the free displacements at 1 MPa modulus; free: (nodes, 3)."""
    nx, ny, nz = box.bricks
    z, y, x = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
    corners = [
        ((z + dz) * (ny + 1) + y + dy) * (nx + 1) + x + dx for dx, dy, dz in BRICK_CORNERS.tolist()
    ]
    nodes = np.stack(corners, axis=-1).reshape(-1, 8)
    number = np.full(free.size, -1)
    number[free.ravel()] = np.arange(np.count_nonzero(free))
    place = number[(3 * nodes[:, :, None] + np.arange(3)).reshape(-1, 24)]
    rows, columns = np.repeat(place, 24, axis=1), np.tile(place, (1, 24))
    values = np.tile(_brick(box.side_mm, poisson).ravel(), (len(nodes), 1))
    mask = (rows >= 0) & (columns >= rows)
    size = int(np.count_nonzero(free))
    entries = (values[mask], (rows[mask], columns[mask]))
    return sp.coo_matrix(entries, shape=(size, size)).tocsr()


def brick_gradients() -> Field:
    """dN_a / dxi_j (8 Gauss points, 8 nodes, 3) of the brick from -1 to 1."""
    signs = 2.0 * BRICK_CORNERS - 1
    factor = 1 + signs[:, None, :] / np.sqrt(3) * signs[None]
    gradients = np.empty((8, 8, 3))
    for j in range(3):
        other_axes = [k for k in range(3) if k != j]
        gradients[:, :, j] = signs[:, j] * factor[..., other_axes].prod(axis=-1) / 8
    return gradients


def _brick(side_mm: tuple[float, float, float], poisson: float) -> Field:
    """Stiffness (24, 24) N/mm of one brick for a modulus of 1 MPa."""
    mu = 1 / (2 * (1 + poisson))
    lame = poisson / ((1 + poisson) * (1 - 2 * poisson))
    side = np.asarray(side_mm)
    gradient = 2 * brick_gradients() / side
    weight = float(side.prod()) / 8
    laplace = np.einsum("qai,qbi->ab", gradient, gradient)
    crossed = np.einsum("qaj,qbi->aibj", gradient, gradient)
    shear = np.einsum("ab,ij->aibj", laplace, np.eye(3)) + crossed
    volume_rate = weight * gradient.sum(axis=0).ravel()
    bulk = lame / float(side.prod()) * np.outer(volume_rate, volume_rate)
    return mu * weight * shear.reshape(24, 24) + bulk


MirrorSigns = tuple[int, int]

MAX_LINEAR_POISSON = 0.4999  # by definition finite; costs up to 0.04 % of the force of a punch
SLAB_PAD = 2  # measured: costs 0.1 % of force against 3, docs/evidence/numerics.md
CELLS_ALONG_SIDE = 24  # by hand: default along the longer side; finer costs minutes once
MAX_CELLS_ALONG_SIDE = 36  # by hand: the same for a gel thinner than such a cell
_SIDES_STORE = Store("gel-sides")
_SYMMETRY_CLASSES: tuple[MirrorSigns, ...] = ((1, 1), (-1, 1), (1, -1), (-1, -1))  # definition


@dataclass(frozen=True, eq=False)
class FreeSides:
    """Effect of the free sides on the face's compliance, for a modulus of 1 MPa.

    x_mm (nx,), y_mm (ny,): nodes of the face, odd numbers of them. quarters (3, 3, 4, q, q) in mm
    MPa / N: displacement component, force component, symmetry class, then the nodes of the quarter
    x >= 0, y >= 0 twice, row by row. Classes: (even, even), (even, odd), (odd, even), (odd, odd) in
    (y, x) of u_z; they act on the amplitudes of `even_odd`.
    """

    x_mm: Field
    y_mm: Field
    quarters: Field


def free_sides(skin: SkinDimensions, poisson: float, cell_mm: float | None = None) -> FreeSides:
    """Effect of the sides of a skin's block, from the cache or computed.

    cell_mm: largest side of a cell; None for CELLS_ALONG_SIDE cells along the longer side, for a
    thin gel up to MAX_CELLS_ALONG_SIDE. The fillet of the edges and the frame are not modelled.
    Raises InputError for a Poisson's ratio over MAX_LINEAR_POISSON or an unusable cell size.
    """
    if not 0 <= poisson <= MAX_LINEAR_POISSON:
        raise InputError(
            f"block: 0 <= poisson <= {MAX_LINEAR_POISSON} is needed: {poisson:g} fails; "
            f"{MAX_LINEAR_POISSON} is within 0.1 % of force of incompressible"
        )
    box = _box(skin, cell_mm)
    key = cache_key(
        "sensor.elasticity.edge_compliance",
        sides_mm=[skin.width_mm, skin.length_mm],
        thickness_mm=skin.thickness_mm,
        cells=box.bricks,
        poisson=poisson,
    )
    a, b = skin.opening_half_mm
    x, y = np.linspace(-a, a, box.bricks[0] + 1), np.linspace(-b, b, box.bricks[1] + 1)
    quarters = _SIDES_STORE.read(key)
    if quarters is None:
        quarters = _quarter_compliances(box, poisson)
        _SIDES_STORE.write(key, quarters)
    return FreeSides(x, y, quarters)


def even_odd(values: Field) -> Field:
    """Amplitudes (2, h, ...) of the even and odd parts of values (2 h - 1, ...) about the centre.

    The map is orthonormal: its transpose is its inverse.
    """
    h = len(values) // 2
    positive, negative = values[h:], values[h::-1]
    parts = np.stack([positive + negative, positive - negative]) / math.sqrt(2)
    parts[0, 0] = values[h]
    return parts


def _box(skin: SkinDimensions, cell_mm: float | None) -> BrickBox:
    """Mesh of the whole block, with even numbers of bricks along x and y."""
    longer = max(skin.width_mm, skin.length_mm)
    size = cell_mm
    if size is None:
        size = min(longer / CELLS_ALONG_SIDE, max(skin.thickness_mm, longer / MAX_CELLS_ALONG_SIDE))
    min_mm, max_mm = longer / 80, min(skin.width_mm, skin.length_mm) / 4
    if not (math.isfinite(size) and min_mm * (1 - 1e-9) <= size <= max_mm):
        raise InputError(
            f"block: cell_mm must be {min_mm:g} to {max_mm:g} mm for a face of {skin.width_mm:g} x "
            f"{skin.length_mm:g} mm: {size:g} fails"
        )
    nx, ny = (2 * math.ceil(side / (2 * size) - 1e-9) for side in (skin.width_mm, skin.length_mm))
    # Several cells over the height also for thin gels.
    step = min(size, skin.thickness_mm / 4)
    layers = math.ceil(skin.thickness_mm / step - 1e-9)
    side = (skin.width_mm / nx, skin.length_mm / ny, skin.thickness_mm / layers)
    return BrickBox((nx, ny, layers), side)


def _quarter_compliances(box: BrickBox, poisson: float) -> Field:
    """Compliance of block minus slab (3, 3, 4, q, q) for a modulus of 1 MPa."""
    kernel = _slab_kernel(box, poisson)
    half_x, half_y, layers = box.bricks[0] // 2, box.bricks[1] // 2, box.bricks[2]
    quarter = BrickBox((half_x, half_y, layers), box.side_mm)
    row, column = (
        i.ravel() for i in np.meshgrid(np.arange(half_y + 1), np.arange(half_x + 1), indexing="ij")
    )
    # The unit force is shared by a node's mirror images.
    root = np.sqrt(np.where(row > 0, 2.0, 1.0) * np.where(column > 0, 2.0, 1.0)) / 2
    q = len(row)
    quarters = np.zeros((3, 3, 4, q, q))
    for i, signs in enumerate(_SYMMETRY_CLASSES):
        free = _free_components(row, column, signs)
        part = _condense(quarter, poisson, np.tile(free, (layers + 1, 1)))
        part -= _slab_response(kernel, row, column, free, signs)
        full = np.zeros((3 * q, 3 * q))
        full[np.ix_(free.ravel(), free.ravel())] = (part + part.T) / 2
        scaled = root[:, None, None, None] * full.reshape(q, 3, q, 3) * root[:, None]
        quarters[:, :, i] = np.transpose(scaled, (1, 3, 0, 2))
    return quarters


def _condense(box: BrickBox, poisson: float, free: NDArray[np.bool_]) -> Field:
    """Compliance (n, n) of the face's free displacements; all node layers but the base are alike.

    Layers are eliminated upwards with dense blocks: fill-in is three quarters of a layer anyway,
    and a sparse factor would need as many right-hand sides.
    """
    free = free.copy()
    free[: box.nodes_a_layer] = False
    upper = stiffness(box, poisson, free)
    n = int(free[-box.nodes_a_layer :].sum())
    rest = np.zeros((n, n))
    for start in range(0, upper.shape[0], n):
        rows = upper[start : start + n].tocsc()
        full = rows[:, start : start + n].toarray()
        full += np.triu(full, 1).T
        factor = scipy.linalg.cholesky(full - rest, True, overwrite_a=True, check_finite=False)
        if start + n < upper.shape[0]:
            above = scipy.linalg.solve_triangular(
                factor, rows[:, start + n : start + 2 * n].toarray(), lower=True,
                overwrite_b=True, check_finite=False,
            )  # fmt: skip
            rest = above.T @ above
    half = scipy.linalg.solve_triangular(factor, np.eye(n), lower=True, check_finite=False)
    return half.T @ half


def _slab_kernel(box: BrickBox, poisson: float) -> Field:
    """Response (3, 3, my, mx) of the periodic slab's face to a force on node 0, offset 0 first.

    For a plane wave, columns of cells differ only in phase, so one column's matrix is enough.
    """
    nx, ny, layers = box.bricks
    levels = layers + 1
    column = BrickBox((1, 1, layers), box.side_mm)
    upper = stiffness(column, poisson, np.ones((column.nodes, 3), dtype=bool)).toarray()
    full = (upper + np.triu(upper, 1).T).reshape(levels, 4, 3, levels, 4, 3)
    my, mx = SLAB_PAD * ny, SLAB_PAD * nx
    ky, kx = 2 * np.pi * scipy.fft.fftfreq(my), 2 * np.pi * scipy.fft.rfftfreq(mx)
    at_y, at_x = (
        np.exp(1j * np.multiply.outer(ky, [0, 1])),
        np.exp(1j * np.multiply.outer(kx, [0, 1])),
    )
    size = 3 * (levels - 1)
    right = np.zeros((size, 3))
    right[-3:] = np.eye(3)
    spectrum = np.empty((my, len(kx), 3, 3), dtype=np.complex128)
    for i in range(my):
        phase = np.einsum("b,ka->kba", at_y[i], at_x).reshape(-1, 4)
        waves = np.einsum("ka,maincj,kc->kminj", phase.conj(), full, phase, optimize=True).reshape(
            len(kx), 3 * levels, 3 * levels
        )[:, 3:, 3:]
        spectrum[i] = np.linalg.solve(waves, right[None])[:, -3:]
    return scipy.fft.irfft2(np.moveaxis(spectrum, (2, 3), (0, 1)), s=(my, mx), axes=(2, 3))


def _free_components(
    row: NDArray[np.int64], column: NDArray[np.int64], signs: MirrorSigns
) -> NDArray[np.bool_]:
    """True for displacements (n, 3) of the quarter's nodes that a symmetry class leaves free.

    signs: +1 mirror-symmetric, -1 antisymmetric, in x and in y.
    """
    free = np.ones((len(row), 3), dtype=bool)
    for axis, on in ((0, column == 0), (1, row == 0)):
        fixed = np.arange(3) == axis if signs[axis] > 0 else np.arange(3) != axis
        free[on] &= ~fixed
    return free


_MIRROR_IMAGES = ((False, False), (True, False), (False, True), (True, True))


def _slab_response(
    kernel: Field,
    row: NDArray[np.int64],
    column: NDArray[np.int64],
    free: NDArray[np.bool_],
    signs: MirrorSigns,
) -> Field:
    """Response (n, n) of the slab to a class's forces on all four quarters."""
    total = np.zeros((len(row), 3, len(row), 3))
    for mirror in _MIRROR_IMAGES:
        x, y = (-column if mirror[0] else column), (-row if mirror[1] else row)
        part = kernel[:, :, row[:, None] - y[None, :], column[:, None] - x[None, :]]
        # Signs of the force components at this mirror image.
        factor = np.ones(3)
        for axis in (0, 1):
            if mirror[axis]:
                factor *= signs[axis]
                factor[axis] *= -1
        part *= factor[None, :, None, None]
        total += np.transpose(part, (2, 0, 3, 1))
    return total[free][:, free]
