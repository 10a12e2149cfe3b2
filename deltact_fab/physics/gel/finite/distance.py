"""Signed distance from an indenter, with its normal and curvature, for contact.

Shanks continue above the tips without end and the back plate lies at `reach_mm` across all of them,
so a deep press cannot slip through the body. Every tip is a profile (d, z) swept along an outline:
d is the distance from the axis (turned tips, spheres), from a segment (ridges) or outside the
outline (prisms); an ellipsoid is an ellipse turned about its long axis. Where the outline's
distance is exact, so is this one outside; inside it is exact down to the nearest medial line.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field
from deltact_fab.sensor import (
    EllipsoidTip,
    Indenter,
    PlainTip,
    PosedTip,
    PrismTip,
    ProfilePiece,
    RidgeTip,
    ShapeError,
    SphereTip,
    Tip,
    TurnedTip,
)

_TINY_LENGTH = 1e-12  # by hand: rounding, keeps divisions finite
_OUTLINE_STEP_MM = 1e-4  # by hand: difference step of a prism's outline; leaves 1e-8 in direction


class Gap(NamedTuple):
    """Distance (n,) in mm, positive outside; normal (n, 3): its gradient, out of the indenter;
    curvature_per_mm (n, 3, 3): its second derivative."""

    distance_mm: Field
    normal: Field
    curvature_per_mm: Field


class _Outline(NamedTuple):
    """Distance d (n,) outside an outline, its gradient (n, 3) and curvature (n,)."""

    d: Field
    out: Field
    bend: Field


class _Profile(NamedTuple):
    """Distance in the profile's plane, normal (n, 2) in (d, z), curvature of the level line."""

    distance: Field
    normal: Field
    bend: Field


def gap(indenter: Indenter, points_mm: Field) -> Gap:
    """Distance of points (n, 3) in the indenter's frame (lowest point at z = 0, body above)."""
    n, z = len(points_mm), points_mm[:, 2]
    best = Gap(indenter.reach_mm - z, np.tile([0.0, 0.0, -1.0], (n, 1)), np.zeros((n, 3, 3)))
    for tip in indenter.tips:
        if isinstance(tip, PosedTip):
            r = tip.turn  # in its own frame, and turned back
            local = _tip(tip.tip, (points_mm - tip.origin_mm) @ r)
            candidate = Gap(local.distance_mm, local.normal @ r.T, r @ local.curvature_per_mm @ r.T)
        else:
            candidate = _tip(tip, points_mm - np.array([tip.x_mm, tip.y_mm, 0.0]))
        nearer = candidate.distance_mm < best.distance_mm
        best = Gap(
            np.where(nearer, candidate.distance_mm, best.distance_mm),
            np.where(nearer[:, None], candidate.normal, best.normal),
            np.where(nearer[:, None, None], candidate.curvature_per_mm, best.curvature_per_mm),
        )
    return best


# A profile: start and [(end, arc's centre or None)...], from its innermost point outwards.
_Chain = tuple[tuple[float, float], list[tuple[tuple[float, float], tuple[float, float] | None]]]


def _tip(tip: PlainTip, p: Field) -> Gap:
    """Distance from one tip and its shank; p (n, 3) relative to the tip's axis."""
    if isinstance(tip, EllipsoidTip):
        return _ellipsoid(tip, p)
    chain: _Chain
    half_mm = 0.0
    if isinstance(tip, PrismTip):
        e = tip.edge_mm
        chain = (-tip.outer_mm, 0.0), [((-e, 0.0), None), ((0.0, e), (-e, e))]
        return _swept(_prism_outline(tip, p), chain, p[:, 2])
    if isinstance(tip, RidgeTip):
        half_mm = tip.length_mm / 2
        nose = (tip.nose_half_mm, tip.nose_height_mm)
        flank = (tip.half_width_mm, tip.equator_mm)
        chain = (0.0, 0.0), [(nose, (0.0, tip.radius_mm)), (flank, None)]
    elif isinstance(tip, SphereTip):
        r = tip.radius_mm
        chain = (0.0, 0.0), [((r, r), (0.0, r))]
    else:
        chain = tip.start_mm, [(piece.end_mm, piece.centre_mm) for piece in tip.pieces]
    return _swept(_segment_outline(p, half_mm), chain, p[:, 2])


def _profile_distance(chain: _Chain, d: Field, z: Field) -> _Profile:
    """Distance to the region above a chain that is a graph over d, closed upwards by shanks."""
    start, pieces = chain
    below = np.full(d.shape, np.inf)  # height of the underside
    best = np.full(d.shape, np.inf)
    normal, bend = np.zeros((*d.shape, 2)), np.zeros(d.shape)

    def take(size: Field, n_d: Field, n_z: Field, curve: Field, valid: NDArray[np.bool_]) -> None:
        nearer = valid & (np.abs(size) < np.abs(best))
        best[nearer] = size[nearer]
        normal[nearer, 0], normal[nearer, 1] = n_d[nearer], n_z[nearer]
        bend[nearer] = curve[nearer]

    ones, zeros = np.ones_like(d), np.zeros_like(d)
    a = start
    corners = [start]
    for end, centre in pieces:
        within = (d >= a[0]) & (d <= end[0])
        if centre is None:
            length = math.dist(a, end)
            td, tz = (end[0] - a[0]) / length, (end[1] - a[1]) / length
            along = (d - a[0]) * td + (z - a[1]) * tz
            offset = (d - a[0]) * tz - (z - a[1]) * td
            take(offset, tz * ones, -td * ones, zeros, (along >= 0) & (along <= length))
            height = a[1] + (d - a[0]) * (tz / td)
        else:
            # An arc that bulges downwards bounds a ball's inside, one upwards its outside.
            up = max(a[1], end[1]) > centre[1] + 1e-9 * math.dist(a, centre)
            side = 1.0 if up else -1.0
            radius = math.dist(a, centre)
            u, v = d - centre[0], z - centre[1]
            r = np.maximum(np.hypot(u, v), _TINY_LENGTH)
            # A point belongs to the arc if its ray from the centre meets it.
            low, high = a[0] - centre[0], end[0] - centre[0]
            ray = u * (radius / r)
            on_arc = (ray >= low - _TINY_LENGTH) & (ray <= high + _TINY_LENGTH) & (side * v >= 0)
            take(side * (radius - r), -side * u / r, -side * v / r, -side / r, on_arc)
            height = centre[1] + side * np.sqrt(np.maximum(radius**2 - u**2, 0.0))
        below = np.where(within, height, below)
        corners.append(end)
        a = end
    take(d - a[0], ones, zeros, zeros, z >= a[1])
    if start[0] > 0:
        take(start[0] - d, -ones, zeros, zeros, z >= start[1])
    inside = z > below
    for c in corners:
        u, v = d - c[0], z - c[1]
        r = np.maximum(np.hypot(u, v), _TINY_LENGTH)
        sign = np.where(inside, -1.0, 1.0)
        # Pieces that meet smoothly there are as near; strictly nearer means a real corner.
        real = r < np.abs(best) * (1 - 1e-9) - 1e-12
        take(sign * r, sign * u / r, sign * v / r, sign / r, real)
    return _Profile(best, normal, bend)


# -- outlines -----------------------------------------------------------------------------------


def _segment_outline(p: Field, half_mm: float) -> _Outline:
    """Distance from the segment |y| <= half_mm on the y axis; half_mm = 0: from the z axis."""
    y = p[:, 1] - np.clip(p[:, 1], -half_mm, half_mm)
    d = np.hypot(p[:, 0], y)
    safe = np.maximum(d, _TINY_LENGTH)
    out = np.stack([p[:, 0] / safe, y / safe, np.zeros_like(d)], axis=1)
    out[d < _TINY_LENGTH] = (1.0, 0.0, 0.0)
    turned = (y != 0) | (half_mm == 0)
    return _Outline(d, out, np.where(turned, 1 / safe, 0.0))


def _prism_outline(tip: PrismTip, p: Field) -> _Outline:
    """Distance outside the outline, negative inside; derivatives by differences."""
    h = _OUTLINE_STEP_MM
    x, y = p[:, 0] + tip.x_mm, p[:, 1] + tip.y_mm
    d = -tip.inset_mm(x, y)
    xp, xm = -tip.inset_mm(x + h, y), -tip.inset_mm(x - h, y)
    yp, ym = -tip.inset_mm(x, y + h), -tip.inset_mm(x, y - h)
    gx, gy = (xp - xm) / (2 * h), (yp - ym) / (2 * h)
    size = np.maximum(np.hypot(gx, gy), _TINY_LENGTH)
    out = np.stack([gx / size, gy / size, np.zeros_like(d)], axis=1)
    # Second derivative across the gradient; the Laplacian would see kinks along it.
    across = (-out[:, 1], out[:, 0])
    ahead = -tip.inset_mm(x + h * across[0], y + h * across[1])
    behind = -tip.inset_mm(x - h * across[0], y - h * across[1])
    bend = np.clip((ahead + behind - 2 * d) / h**2, -1e3, 1e3)
    return _Outline(d, out, bend)


# -- bodies -------------------------------------------------------------------------------------


def _swept(outline: _Outline, chain: _Chain, z: Field) -> Gap:
    flat = _profile_distance(chain, outline.d, z)
    n_d, n_z = flat.normal[:, 0], flat.normal[:, 1]
    up = np.array([0.0, 0.0, 1.0])
    normal = n_d[:, None] * outline.out + n_z[:, None] * up
    tangent = -n_z[:, None] * outline.out + n_d[:, None] * up
    across = np.stack([-outline.out[:, 1], outline.out[:, 0], np.zeros_like(n_d)], axis=1)
    # On the axis both principal curvatures are those of the profile.
    axis = (outline.bend > 1e8) & (outline.d >= 0)
    hoop = np.where(axis, flat.bend, n_d * np.where(axis, 0.0, outline.bend))
    curvature = flat.bend[:, None, None] * tangent[:, :, None] * tangent[:, None, :]
    curvature += hoop[:, None, None] * across[:, :, None] * across[:, None, :]
    return Gap(flat.distance, normal, curvature)


def _ellipsoid(tip: EllipsoidTip, p: Field) -> Gap:
    """Half a spheroid about the x axis below z = b, its elliptic cylinder above."""
    a, b = tip.a_mm, tip.b_mm
    low = np.minimum(p[:, 2] - b, 0.0)
    rho = np.hypot(p[:, 1], low)
    safe = np.maximum(rho, _TINY_LENGTH)
    out = np.stack([np.zeros_like(rho), p[:, 1] / safe, low / safe], axis=1)
    size, n_x, n_r, bend = _ellipse(a, b, np.abs(p[:, 0]), rho)
    n_x = n_x * np.where(p[:, 0] < 0, -1.0, 1.0)
    along = np.array([1.0, 0.0, 0.0])
    normal = n_x[:, None] * along + n_r[:, None] * out
    tangent = -n_r[:, None] * along + n_x[:, None] * out
    across = np.cross(along, out)
    hoop = np.where(low < 0, n_r / safe, 0.0)
    curvature = bend[:, None, None] * tangent[:, :, None] * tangent[:, None, :]
    curvature += hoop[:, None, None] * across[:, :, None] * across[:, None, :]
    return Gap(size, normal, curvature)


def _ellipse(a: float, b: float, x: Field, y: Field) -> tuple[Field, Field, Field, Field]:
    """Distance, normal and curvature at points with x, y >= 0 of an ellipse with semi-axes a, b.

    The foot is (a^2 x / (t + a^2), b^2 y / (t + b^2)), t the largest root of F(t) =
    (a x / (t + a^2))^2 + (b y / (t + b^2))^2 - 1 (Eberly, Distance from a point to an ellipse);
    F is convex and falls from infinity there, so Newton from below does not overshoot.
    """
    t = np.maximum(a * x - a**2, b * y - b**2) + _TINY_LENGTH
    for _ in range(60):
        p, q = a * x / (t + a**2), b * y / (t + b**2)
        value = p**2 + q**2 - 1
        slope = -2 * (p**2 / (t + a**2) + q**2 / (t + b**2))
        step = np.where(slope < 0, -value / np.minimum(slope, -_TINY_LENGTH), 0.0)
        t = t + np.maximum(step, 0.0)
        if np.all(np.abs(step) <= 1e-14 * (np.abs(t) + min(a, b) ** 2)):
            break
    fx, fy = a**2 * x / (t + a**2), b**2 * y / (t + b**2)
    nx, ny = fx / a**2, fy / b**2
    grad = np.maximum(np.hypot(nx, ny), _TINY_LENGTH)
    nx, ny = nx / grad, ny / grad
    size = (x - fx) * nx + (y - fy) * ny
    radius = (a * b) ** 2 * grad**3
    return size, nx, ny, 1 / np.maximum(radius + size, _TINY_LENGTH)


BLUNT_CELLS = 0.5  # least radius over cell size; by hand: less, and contact points jump over edges


RIM_CELLS = 0.22  # cells by which a flat's rim acts further out; measured, docs/evidence/gel.md
SHARP_CELLS = 2.0  # radius of an edge in cells, below which it is sharp; measured, as above


def blunted(indenter: Indenter, cell_mm: float) -> Indenter:
    """Adapt the edges of an indenter to the cells: rounder, and the rims of flats further in.

    A facet cannot follow an edge that turns within it: its contact points jump between the two
    sides and Newton's method does not settle. So radii are at least BLUNT_CELLS x cell_mm where
    possible. A cell that the rim of a flat crosses is held flat by its covered part, as if the rim
    lay RIM_CELLS further out; so it is moved in by that. Both shrink with the mesh. The lowest
    point, name and reach stay.
    """
    return replace(indenter, tips=tuple(_blunt(tip, cell_mm) for tip in indenter.tips))


def _blunt(tip: Tip, cell_mm: float) -> Tip:
    """Adapt a tip, as far as its dimensions allow."""
    for share in (1.0, 0.8, 0.6, 0.4):
        with contextlib.suppress(ShapeError):
            return _with_radius(tip, share * BLUNT_CELLS * cell_mm, share * RIM_CELLS * cell_mm)
    return tip


def _with_radius(tip: Tip, radius_mm: float, inset_mm: float) -> Tip:
    if isinstance(tip, PosedTip):
        plain = _with_radius(tip.tip, radius_mm, inset_mm)
        return tip if isinstance(plain, PosedTip) else replace(tip, tip=plain)
    if isinstance(tip, PrismTip):
        edge, corner = max(tip.edge_mm, radius_mm), max(tip.corner_mm, radius_mm)
        # A rounded edge needs a corner at least as round to be swept along.
        return replace(
            tip, outer_mm=tip.outer_mm - inset_mm, inner_mm=tip.inner_mm - inset_mm, edge_mm=edge,
            corner_mm=max(corner, edge + tip.corner_mm - tip.edge_mm),
        )  # fmt: skip
    if isinstance(tip, RidgeTip):
        return replace(tip, radius_mm=max(tip.radius_mm, radius_mm))
    if isinstance(tip, TurnedTip):
        return replace(tip, pieces=_rounded_rim(tip, radius_mm, inset_mm))
    return tip


def _rounded_rim(tip: TurnedTip, radius_mm: float, inset_mm: float) -> tuple[ProfilePiece, ...]:
    """Widen and inset the last arc, from a flat face up to the rim; other profiles stay."""
    *inner, last = tip.pieces
    if last.centre_mm is None or not inner or inner[-1].centre_mm is not None:
        return tip.pieces
    rim, top = last.end_mm
    foot = inner[-1].end_mm
    old = rim - last.centre_mm[0]
    if abs(top - foot[1] - old) > 1e-9:
        return tip.pieces
    rim, radius_mm = rim - inset_mm, max(old, radius_mm)
    start = (rim - radius_mm, foot[1])
    high = foot[1] + radius_mm
    return (*inner[:-1], ProfilePiece(start), ProfilePiece((rim, high), (start[0], high)))
