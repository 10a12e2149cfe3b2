"""Trust in a lens calibration: sigma over the view, and reasons to refuse it."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Array, InputError
from deltact_fab.sensor import SensorDimensions

from .problem import PRIOR_STEP, SYSTEMATIC_PX, LensProblem, LensSolution

DEPTHS_MM = (3.0, 6.0)  # below the face, at which sigma is reported; by hand: depths of presses
# Limits of decision 0019, the others by hand: looser ones pass a wrong board, tighter ones refuse
# good photographs (docs/evidence/lens.md).
MIN_VIEW_COVER = 0.8
MAX_FACE_SIGMA_PX = 0.15
PRIOR_SHARE = 0.5  # posterior over prior sigma of a weak prior; more: no image determines it
MAX_NOISE_PX = 0.25
MAX_SMOOTH_PX = 0.08  # of a smooth pattern in an image's residuals, which a wrong board leaves
MAX_OUTLIERS = 0.1
MIN_HEIGHT_MM = 0.05
MAX_STRETCH = 0.0025  # rows against columns; chips are made to 1e-4, elements of a lens add 1e-3


def view_mm(sensor: SensorDimensions) -> NDArray[np.float64]:
    """Return a grid of points over the view on the resting face, (n, 2) mm."""
    half = np.array(sensor.optics.view_mm) / 2
    x, y = (np.linspace(-h, h, n) for h, n in zip(half, (25, 19), strict=True))
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


def sigma_px(
    problem: LensProblem, fit: LensSolution, sensor: SensorDimensions, depth_mm: float
) -> float:
    """Sigma of projected points, px in the raw image; 95th percentile over the view.

    For points depth_mm below the face; both axes together, including the systematic error.
    """
    lens = problem.lens(fit.x)
    origin, slope = lens.ray(lens.rest_px(view_mm(sensor)), "gel")
    points = origin - depth_mm * slope
    projected = lens.project_px(points)
    n = len(problem.names)
    j = np.empty((*projected.shape, n))
    for k in range(n):
        shifted = fit.x.copy()
        shifted[k] += PRIOR_STEP
        j[..., k] = (problem.lens(shifted).project_px(points) - projected) / PRIOR_STEP
    var = np.einsum("pak,kl,pal->p", j, fit.covariance[:n, :n], j) + 2 * SYSTEMATIC_PX**2
    return float(np.percentile(np.sqrt(var), 95))


def cover(problem: LensProblem, fit: LensSolution, sensor: SensorDimensions) -> float:
    """Fraction of the view inside the hulls of the contact corners, widened by half a square."""
    half = np.array(sensor.optics.view_mm) / 2
    per_mm = 10.0
    mask = np.zeros(np.ceil(2 * half[::-1] * per_mm).astype(int), np.uint8)
    points_mm = problem.points_mm(fit.x)[:, :2]
    for view, rows in zip(problem.views, problem.rows, strict=True):
        points = points_mm[rows][fit.inliers[rows]]
        if not view.contact or len(points) < 3:
            continue
        middle = points.mean(0)
        out = points - middle
        reach = np.linalg.norm(out, axis=1, keepdims=True)
        wider = middle + out * (1 + 0.5 * view.corners.board.square_mm / np.maximum(reach, 1e-9))
        hull = cv2.convexHull(((wider + half) * per_mm).astype(np.float32))
        cv2.fillConvexPoly(mask, np.rint(hull).astype(np.int32), 1)
    return float(mask.mean())


def smooth_px(px: Array, off_px: Array) -> float:
    """Rms of the smooth part of residuals (n, 2) at px (n, 2), corrected for noise."""
    span = np.ptp(px, axis=0)
    x, y = ((px - px.mean(0)) / np.maximum(span, 1e-9) * 2).T
    terms = np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1)
    free = len(px) - terms.shape[1]
    if free < terms.shape[1]:
        return 0.0
    part = terms @ np.linalg.lstsq(terms, off_px, rcond=None)[0]
    noise = np.sum((off_px - part) ** 2) / free
    return float(np.sqrt(max(np.sum(part**2) - noise * terms.shape[1], 0) / len(px)))


def refuse(
    problem: LensProblem, fit: LensSolution, share: Sequence[float], covered: float, face_px: float
) -> None:
    """Raise InputError, in one line, for a calibration that must not be used.

    share: posterior over prior sigma. covered: see `cover`. face_px: sigma on the face.
    """
    _refuse_misfit(problem, fit)
    stretch = problem.lens(fit.x).aspect - 1
    if abs(stretch) > MAX_STRETCH:
        raise InputError(
            f"lengths along y are {abs(stretch):.2%} {'longer' if stretch > 0 else 'shorter'} than "
            f"along x (limit {MAX_STRETCH:.2%}): the print or the image is stretched"
        )
    if covered < MIN_VIEW_COVER:
        raise InputError(
            f"the contact corners cover {covered:.0%} of the view (minimum {MIN_VIEW_COVER:.0%}): "
            "add contact images nearer its edges, or use the chessboard skin"
        )
    unknown = [
        name
        for (name, prior), remaining in zip(problem.priors.items(), share, strict=True)
        if prior.weak and not remaining <= PRIOR_SHARE
    ]
    if unknown:
        raise InputError(
            f"{', '.join(unknown)}: not determined by these images: add boards "
            "in air at several heights and tilts, or use the chessboard skin"
        )
    if not face_px <= MAX_FACE_SIGMA_PX:
        raise InputError(
            f"uncertainty of the face: {face_px:.3f} px, one sigma (limit {MAX_FACE_SIGMA_PX:g}): "
            "add contact images, or sharper ones"
        )


def _refuse_misfit(problem: LensProblem, fit: LensSolution) -> None:
    points = problem.points_mm(fit.x)
    for view, rows in zip(problem.views, problem.rows, strict=True):
        residual, ok = fit.residual_px[rows], fit.inliers[rows]
        if not view.contact and points[rows, 2].min() < MIN_HEIGHT_MM:
            raise InputError(
                f"{view.corners.source}: the board touches the face, but the image was given as "
                "one in air; is it a contact image?"
            )
        rms = float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))
        outlier_share = 1 - ok.mean()
        smooth = smooth_px(view.corners.px[ok], residual[ok]) if ok.sum() > 3 else np.inf
        if outlier_share > MAX_OUTLIERS or smooth > MAX_SMOOTH_PX or rms > 10 * MAX_NOISE_PX:
            flat = "not flat on the face" if view.contact else "not flat"
            raise InputError(
                f"{view.corners.source}: corner residuals of {rms:.2f} px rms are not random: "
                f"not a board of {view.corners.board}, {flat}, or another lens model "
                "(theta to theta^9, decentring, aspect)"
            )
    if fit.noise_px > MAX_NOISE_PX:
        raise InputError(
            f"corner residuals of {fit.noise_px:.2f} px rms (limit {MAX_NOISE_PX:g}): "
            "blurred images, or not the named board"
        )
