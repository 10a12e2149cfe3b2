"""Where a linear level stops: too deep, off the face or the indenter, folded."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ...aliases import Field, Mask, Point
from ...elasticity.face import FaceOperator
from ...errors import InputError, SolverError
from ...shapes import Indenter
from .patch import span

DEPTH_LIMIT = 0.25  # of the thickness: force is still within some per cent of finite strain there
FOLD_LIMIT = 0.2  # least det(I + grad u) of the face; at 0 the printed pattern folds over


def refuse_out_of_range(layer: FaceOperator, indenter: Indenter, tip_mm: Point) -> None:
    """Raises InputError for a tip that is deeper than the level reaches, or off the face."""
    x, y, depth = tip_mm
    limit = DEPTH_LIMIT * layer.thickness_mm
    if depth > limit * (1 + 1e-12):
        raise InputError(
            f"contact: depth {depth:g} mm is over {limit:g} mm, {100 * DEPTH_LIMIT:g} % of the "
            "gel's thickness: the linear layer stops there and a finite-strain level is needed"
        )
    if depth >= indenter.equator_mm:
        raise InputError(
            f"contact: depth {depth:g} mm presses {indenter.name} to its equator; "
            f"it reaches below {indenter.equator_mm:g} mm"
        )
    half_x, half_y = layer.face_half_mm
    if abs(x) > half_x or abs(y) > half_y:
        raise InputError(
            f"contact: tip at ({x:g}, {y:g}) mm is off the face of +-{half_x:g} x +-{half_y:g} mm"
        )


def refuse_bad_contact(
    layer: FaceOperator, indenter: Indenter, tip_mm: Point, height_mm: Field, contact: Mask,
    x_mm: Field, y_mm: Field,
) -> None:  # fmt: skip
    """Raises SolverError where nothing is under pressure, or contact runs off indenter or face.

    height_mm, contact (my, mx): over the nodes of a patch at x_mm (mx,), y_mm (my,).
    """
    depth = tip_mm[2]
    if not contact.any():
        raise SolverError(
            f"contact: {indenter.name} at depth {depth:g} mm found no node under pressure"
        )
    beside = ndimage.binary_dilation(contact) & ~np.isfinite(height_mm)
    if beside.any():
        raise SolverError(
            f"contact: at depth {depth:g} mm the contact reaches the edge of "
            f"{indenter.name}, where its height field ends; less depth is needed"
        )
    reach = (
        float(np.abs(x_mm[contact.any(axis=0)]).max()),
        float(np.abs(y_mm[contact.any(axis=1)]).max()),
    )
    half = layer.face_half_mm
    if reach[0] > half[0] or reach[1] > half[1]:
        raise SolverError(
            f"contact: it runs to ({reach[0]:.2f}, {reach[1]:.2f}) mm from the centre, over "
            f"the face of +-{half[0]:g} x +-{half[1]:g} mm"
        )


def least_det(layer: FaceOperator, displacement_mm: Field, tip_mm: Point) -> float:
    """Smallest in-plane det(I + grad u) on the face; raises SolverError below FOLD_LIMIT."""
    half = layer.face_half_mm
    rows, columns = span(np.abs(layer.y_mm) <= half[1]), span(np.abs(layer.x_mm) <= half[0])
    dx, dy = layer.spacing_mm
    ux, uy = displacement_mm[rows, columns, 0], displacement_mm[rows, columns, 1]
    xy, xx = np.gradient(ux, dy, dx)
    yy, yx = np.gradient(uy, dy, dx)
    det = float(((1 + xx) * (1 + yy) - xy * yx).min())
    if det < FOLD_LIMIT:
        raise SolverError(
            f"contact: the face is squeezed to det(I + grad u) = {det:.2f} at depth "
            f"{tip_mm[2]:g} mm, below {FOLD_LIMIT}: a finite-strain level is needed"
        )
    return det
