"""Validity limits of the linear level (depth, face, indenter, folding), and its model error.

The constants are measured: docs/evidence/gel.md has the tables.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from deltact_fab.common import Field, InputError, Point, SolverError
from deltact_fab.sensor import MAX_LINEAR_POISSON, FreeBlock, GelMaterial, Indenter, SkinDimensions

from ..level import contact_radius_mm

DEPTH_LIMIT = 0.25  # of the thickness, by hand: force within some per cent of finite strain
FOLD_LIMIT = 0.2  # least det(I + grad u) of the face; by hand: at 0 the printed pattern folds
# Measured, docs/evidence/gel.md: relative force, and in plane.
TIP_FORCE = 1.05  # x (poisson - EVEN_POISSON) x depth/contact radius: too stiff above it
EVEN_POISSON = 0.42
BEND_FORCE = 1.0  # x (depth/thickness)^2: too soft
SPREAD_FORCE = 0.02  # x depth/contact radius: scatter about the two
BEND_IN_PLANE = (0.13, 0.4)  # x depth^2 sqrt(pi/face), with 1 and (contact radius/thickness)^2
MIN_IN_PLANE = 0.002  # x depth: resolution of the reference, a disc in place of the block


def linear_refusal(
    skin: SkinDimensions, material: GelMaterial, indenter: Indenter, depth_mm: float
) -> str | None:
    """Return the reason why the level does not support a press to that depth, or None."""
    if material.prony:
        return "it does not support a Prony series"
    if material.poisson > MAX_LINEAR_POISSON:
        return f"poisson must be <= {MAX_LINEAR_POISSON} (got {material.poisson:g})"
    return _too_deep(skin.thickness_mm, indenter, depth_mm)


def _too_deep(thickness_mm: float, indenter: Indenter, depth_mm: float) -> str | None:
    limit = DEPTH_LIMIT * thickness_mm
    if depth_mm > limit * (1 + 1e-12):
        return f"depth {depth_mm:g} mm is over {limit:g} mm, {DEPTH_LIMIT:.0%} of the thickness"
    if depth_mm >= indenter.equator_mm:
        rim = indenter.equator_mm
        return f"depth {depth_mm:g} mm presses {indenter.name} to {rim:g} mm, its rim"
    return None


def model_error(
    skin: SkinDimensions, indenter: Indenter, depth_mm: float, poisson: float
) -> tuple[float, float]:
    """Error from neglected large strain: of the force, relative, and in plane, mm rms.

    Under the tip it is of the order depth/contact radius, with a sign that depends on Poisson's
    ratio; over the thickness it is of second order.
    """
    if depth_mm <= 0:
        return 0.0, 0.0
    radius, thickness = contact_radius_mm(indenter, depth_mm), skin.thickness_mm
    steep = depth_mm / radius
    tip = TIP_FORCE * (poisson - EVEN_POISSON) * steep
    bend = BEND_FORCE * (depth_mm / thickness) ** 2
    # Where their signs differ, they are not assumed to cancel.
    force = max(tip, bend + max(-tip, 0.0)) + SPREAD_FORCE * steep
    in_plane = BEND_IN_PLANE[0] + BEND_IN_PLANE[1] * (radius / thickness) ** 2
    in_plane *= depth_mm**2 * math.sqrt(math.pi / (skin.width_mm * skin.length_mm))
    return force, in_plane + MIN_IN_PLANE * depth_mm


def refuse_out_of_range(face: FreeBlock, indenter: Indenter, tip_mm: Point) -> None:
    """Raise InputError for a tip too deep for the level, or off the face."""
    x, y, depth = tip_mm
    if reason := _too_deep(face.thickness_mm, indenter, depth):
        raise InputError(f"contact: {reason}; use level hyperelastic")
    dx, dy = face.spacing_mm
    half_x, half_y = face.x_mm[-1] + dx / 2, face.y_mm[-1] + dy / 2
    if abs(x) > half_x or abs(y) > half_y:
        raise InputError(
            f"contact: tip at ({x:g}, {y:g}) mm is off the face of +-{half_x:g} x +-{half_y:g} mm"
        )


def refuse_bad_contact(
    indenter: Indenter, tip_mm: Point, height_mm: Field, contact: NDArray[np.bool_]
) -> None:
    """Raise SolverError where nothing is under pressure, or contact runs off the indenter.

    height_mm, contact (my, mx): over the nodes of a patch.
    """
    depth = tip_mm[2]
    if not contact.any():
        raise SolverError(
            f"contact: {indenter.name} at depth {depth:g} mm has no node under pressure"
        )
    edge = ndimage.binary_dilation(contact) & ~np.isfinite(height_mm)
    if edge.any():
        raise SolverError(
            f"contact: at depth {depth:g} mm the contact reaches the edge of "
            f"{indenter.name}, where its height field ends; less depth is needed"
        )


def least_det(face: FreeBlock, displacement_mm: Field, tip_mm: Point) -> float:
    """Smallest in-plane det(I + grad u) on the face. Raises SolverError below FOLD_LIMIT."""
    dx, dy = face.spacing_mm
    ux, uy = displacement_mm[..., 0], displacement_mm[..., 1]
    xy, xx = np.gradient(ux, dy, dx)
    yy, yx = np.gradient(uy, dy, dx)
    det = float(((1 + xx) * (1 + yy) - xy * yx).min())
    if det < FOLD_LIMIT:
        raise SolverError(
            f"contact: the face is squeezed to det(I + grad u) = {det:.2f} at depth "
            f"{tip_mm[2]:g} mm, below {FOLD_LIMIT}: a finite-strain level is needed"
        )
    return det
