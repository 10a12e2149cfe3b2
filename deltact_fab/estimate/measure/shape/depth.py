"""Depth of the face in mm, calibrated on a ball, and the separate contacts in its map.

Depth shows as motion off the optical axis and hardly at all on it, so no local rule gives depth
from flow. The inverse of the face's linear operator does (`force.inverse`): its traction displaces
the face in depth too, by 3 to 14 % too little (docs/evidence/strangers.md); a gain corrects that.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from deltact_fab.common import Array, validate
from deltact_fab.sensor import CameraModel, interpolate_block

from ..face import FaceFlow, fill_unknown, fit_rigid_motion
from ..force.inverse import inverse_for
from ..force.model import MIN_COVER, TractionField
from ..sensor_id import CalibrationHead, SensorModel, read_calibration

MAX_RIGID_RESIDUAL = 0.1  # over the motion; by hand: larger takes light presses for a loose camera
EXTRAPOLATION_FACTOR = 1.1  # over the calibration's deepest press; by hand: above noise of a peak


@dataclass(frozen=True)
class DepthModel:
    """Depth calibration. gain: true depth over that of the inverse. deepest_mm: its deepest press.

    poisson, thickness_mm: gel used by the inverse; None: the view's.
    """

    gain: Annotated[float, Ge(0.1), Le(10)]
    deepest_mm: Annotated[float, Gt(0), Le(20)]
    poisson: Annotated[float, Gt(0), Lt(0.5)] | None = None
    thickness_mm: Annotated[float, Gt(0), Le(100)] | None = None

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - read by catalog.validate

    def as_dict(self) -> dict[str, float]:
        return {name: value for name, value in asdict(self).items() if value is not None}

    def view(self, view: SensorModel) -> SensorModel:
        """Return the view with the gel that the gain was calibrated with."""
        return view.with_gel(
            self.poisson or view.poisson, self.thickness_mm or view.skin.thickness_mm
        )

    @classmethod
    def load(cls, path: Path) -> tuple[CalibrationHead, DepthModel]:
        """Load a file written by `calibrate depth`. Raises InputError of one line."""
        head, data = read_calibration(path, "depth")
        return head, validate(cls, data.get("depth", {}), f"{path}: depth")


@dataclass(frozen=True)
class Depth:
    """Depth of the resting face's points into the gel.

    depth_mm (h, w) float32, at least 0; valid (h, w) bool: motion known; x_mm (w,), y_mm (h,): as
    in FaceFlow. cover: share of the pressure on cells whose motion is known. extrapolated: deeper
    than the calibration, or less than MIN_COVER known.
    """

    depth_mm: Array
    valid: Array
    x_mm: Array
    y_mm: Array
    cover: float
    extrapolated: bool

    @property
    def cell_mm(self) -> float:
        return float(self.x_mm[1] - self.x_mm[0])


class DepthFinder:
    """Depth and contacts of one sensor's flows, by a calibration."""

    def __init__(self, view: SensorModel, model: DepthModel) -> None:
        self.view, self.model = model.view(view), model
        self.inverse = inverse_for(self.view)

    def find(self, flow: FaceFlow) -> Depth:
        """Find the depth of a flow, in mm."""
        flow = fill_unknown(flow)
        press = self.inverse.solve(flow)
        depth = np.maximum(np.float32(self.model.gain) * self.linear_depth_mm(flow, press), 0)
        too_deep = float(depth.max()) > EXTRAPOLATION_FACTOR * self.model.deepest_mm
        extrapolated = too_deep or press.cover < MIN_COVER
        return Depth(depth, flow.known, flow.x_mm, flow.y_mm, press.cover, extrapolated)

    def contacts(self, flow: FaceFlow) -> list[ContactRegion]:
        """Find the contacts of a flow, as `find_contacts`, without shares of the force."""
        return find_contacts(self.find(flow), flow, self.view.camera)

    def linear_depth_mm(self, flow: FaceFlow, press: TractionField) -> Array:
        """Uncalibrated depth (h, w) float32 by linear elasticity, at the flow's points."""
        if not press.pressed or is_rigid(flow):
            return np.zeros(flow.known.shape, np.float32)
        onto_y, onto_x = (
            _spline(tuple(knots.tolist()), tuple(points.tolist()))
            for knots, points in (
                (self.inverse.seen_y_mm, flow.y_mm), (self.inverse.seen_x_mm, flow.x_mm),
            )
        )  # fmt: skip
        return np.asarray(onto_y @ self.inverse.indentation_mm(press) @ onto_x.T)


@lru_cache(maxsize=8)
def _spline(knots_mm: tuple[float, ...], points_mm: tuple[float, ...]) -> Array:
    """Matrix (points, knots) of the cubic spline, level beyond the outer knots."""
    knots, points = np.array(knots_mm), np.clip(points_mm, knots_mm[0], knots_mm[-1])
    return interpolate_block(knots, points).astype(np.float32)


def is_rigid(flow: FaceFlow) -> bool:
    """True if the view moved as a whole (shift and rotation), as with a loose camera.

    The criterion is a residual from the best rigid motion below MAX_RIGID_RESIDUAL of the motion.
    """
    if not flow.known.any():
        return False
    *_, residual = fit_rigid_motion(flow)
    shift = flow.shift_mm[flow.known].astype(float)
    return bool((residual**2).sum() < MAX_RIGID_RESIDUAL**2 * (shift**2).sum())


def ball_depth_mm(flow: FaceFlow, view: SensorModel, tip_mm: Array, radius_mm: float) -> Array:
    """Depth (h, w) of a ball at the points of a flow, 0 where they are not below it.

    tip_mm (3,): lowest point of the ball, sensor frame. A point is seen along a ray that meets the
    ball at its depth, so both are found by fixed-point iteration.
    """
    camera = view.camera
    landed = np.stack(np.meshgrid(flow.x_mm, flow.y_mm), axis=-1) + flow.shift_mm
    origin, direction = camera.ray(camera.rest_px(landed))
    depth = np.zeros(flow.known.shape)
    for _ in range(12):
        place = origin[..., :2] - direction[..., :2] * depth[..., None]
        far2 = ((place - tip_mm[:2]) ** 2).sum(-1)
        below = far2 < radius_mm**2 / 2
        rise = radius_mm - np.sqrt(np.maximum(radius_mm**2 - far2, radius_mm**2 / 2))
        depth = np.where(below, np.maximum(-tip_mm[2] - rise, 0), 0)
    return depth


RIM_SHARE = 0.3  # of a contact's peak depth, where it ends: the rim of a ball, decision 0025
MIN_PEAK_MM = 0.05  # of a contact; by hand: less is noise (see `inverse.NOISE_FACTOR`)
DIP_SHARE = 0.75  # of the lower of two peaks, below which they are two contacts, decision 0025
# Number of contacts in a region; measured: docs/evidence/shape.md, Contacts near each other.
SHALLOW_DIP_SHARE = 0.9  # as DIP_SHARE, within a region; measured: 1 ball of 1400 dips deeper
CORE_SHARE = 0.5  # of the peak depth; measured: less noise than at the rim, blind to a lower peak
ROUND_ELONGATION = 1.15  # ratio of axes; measured: higher passes pairs, lower fails balls
ELONGATION_ERROR_MM = 0.015  # over the peak depth, added to it; measured on the same presses
MIN_COUNT_DEPTH_MM = 0.1  # of the peak; measured: below, noise draws balls out as far as a pair
UNEQUAL_FACTOR = 1.5  # over the distance at which equal contacts are not one; measured on pairs
OUTLINE_CELL_MM = 0.08  # of the map for outlines; by hand: finer draws no smoother line


ContactCount = Literal["one", "two or more", "cannot tell"]


@dataclass(frozen=True)
class ContactRegion:
    """One region of contact.

    area_mm2, centroid_mm (2,), outline_mm (n, 2) closed, anticlockwise as the camera sees it: on
    the resting face, like all maps. place_mm (2,): current place of the depth's centroid, which
    differs after a shear. peak_depth_mm: into the gel. force_share: of the total pressure, None
    without a traction. cover: share of the region whose motion is known.

    count: contacts in the region. "one": as round as one contact through this gel. "two or more":
    more than one peak. "cannot tell": drawn out, by contacts near each other or by one long
    contact; or shallow, hidden, or cut off by the edge of the view. resolution_mm: least distance
    between two contacts of similar depth that is not taken for "one".
    """

    area_mm2: float
    centroid_mm: Array
    outline_mm: Array
    place_mm: Array
    peak_depth_mm: float
    force_share: float | None
    cover: float
    count: ContactCount
    resolution_mm: float


def find_contacts(
    depth: Depth, flow: FaceFlow, camera: CameraModel, traction: TractionField | None = None
) -> list[ContactRegion]:
    """Find the contacts of one frame, the deepest first; none at rest.

    flow: source of the depth. traction: for the shares of the force.
    """
    labels, flow = contact_labels(depth), fill_unknown(flow)
    shares = None if traction is None else _pressure_shares(traction, labels, depth)
    masks = [labels == k for k in range(1, int(labels.max()) + 1)]
    if not masks:
        return []
    places = _centroids(masks, depth, flow, camera)
    rows, columns = np.transpose(_find_peaks(depth.depth_mm, SHALLOW_DIP_SHARE))
    peaks = np.bincount(labels[rows, columns], minlength=len(masks) + 1)
    regions = [
        _contact(mask, depth, place, None if shares is None else float(shares[k]), int(peaks[k]))
        for k, (mask, place) in enumerate(zip(masks, places, strict=True), 1)
    ]
    return sorted(regions, key=lambda contact: -contact.peak_depth_mm)


def contact_labels(depth: Depth) -> Array:
    """Label of the contact that each point is in, (h, w) int32; 0: none."""
    peaks = _find_peaks(depth.depth_mm, DIP_SHARE)
    out = np.zeros(depth.depth_mm.shape, np.int32)
    if not peaks:
        return out
    rows, columns = np.indices(out.shape)
    nearest = np.argmin([(rows - r) ** 2 + (columns - c) ** 2 for r, c in peaks], axis=0)
    for k, peak in enumerate(peaks):
        deep = (nearest == k) & (depth.depth_mm >= RIM_SHARE * depth.depth_mm[peak])
        parts = _label_parts(deep)
        out[parts == parts[peak]] = k + 1
    return out


def _find_peaks(depth_mm: Array, dip_share: float) -> list[tuple[int, int]]:
    """Find the peaks that a dip separates from every deeper one, as (row, column)."""
    around = cv2.dilate(depth_mm, np.ones((5, 5), np.uint8))
    highest = (around == depth_mm) & (depth_mm >= MIN_PEAK_MM)
    rows, columns = np.nonzero(highest)
    order = np.argsort(-depth_mm[rows, columns], kind="stable")
    peaks: list[tuple[int, int]] = []
    for row, column in zip(rows[order], columns[order], strict=True):
        parts = _label_parts(depth_mm >= dip_share * depth_mm[row, column])
        if not any(parts[peak] == parts[row, column] for peak in peaks):
            peaks.append((int(row), int(column)))
    return peaks


def _label_parts(mask: Array) -> Array:
    """Label the connected components of a mask (4-neighbours), (h, w) int32."""
    return cv2.connectedComponents(mask.view(np.uint8), connectivity=4)[1]


def _centroids(masks: list[Array], depth: Depth, flow: FaceFlow, camera: CameraModel) -> Array:
    """Current centroid of the depth in each region, (n, 2) mm."""
    landed, sunk = np.empty((len(masks), 2)), np.empty((len(masks), 1))
    for k, mask in enumerate(masks):
        weight = np.where(mask, depth.depth_mm, 0)
        total = float(weight.sum())
        mean = (weight.sum(0) @ depth.x_mm) / total, (weight.sum(1) @ depth.y_mm) / total
        shift = [float((weight * flow.shift_mm[..., i]).sum()) / total for i in (0, 1)]
        landed[k], sunk[k] = np.add(mean, shift), float((weight**2).sum()) / total
    origin, direction = camera.ray(camera.rest_px(landed))  # one call: slow for few points
    return np.asarray(origin[:, :2] - direction[:, :2] * sunk)


def _contact(
    mask: Array, depth: Depth, place_mm: Array, share: float | None, n_peaks: int
) -> ContactRegion:
    rows, columns = np.nonzero(mask)
    centroid = np.array([depth.x_mm[columns].mean(), depth.y_mm[rows].mean()])
    return ContactRegion(
        float(len(rows)) * depth.cell_mm**2,
        centroid,
        _outline(mask, depth),
        place_mm,
        float(depth.depth_mm[mask].max()),
        share,
        float(depth.valid[mask].mean()),
        *_count_contacts(mask, depth, n_peaks),
    )


def _count_contacts(mask: Array, depth: Depth, n_peaks: int) -> tuple[ContactCount, float]:
    """Number of contacts in a region, and the distance that resolves two, in mm.

    Two equal contacts draw a round region out: (long / short)^2 = 1 + (distance / 2 short)^2.
    """
    peak_mm = float(depth.depth_mm[mask].max())
    limit = ROUND_ELONGATION + ELONGATION_ERROR_MM / peak_mm
    axes_mm = [_principal_axes_mm(mask, depth, share) for share in (RIM_SHARE, CORE_SHARE)]
    short_mm = max(short for _, short in axes_mm)
    resolution_mm = UNEQUAL_FACTOR * 2 * short_mm * math.sqrt(limit**2 - 1)
    edges = (mask[0], mask[-1], mask[:, 0], mask[:, -1])
    if any(edge.any() for edge in edges) or depth.valid[mask].mean() < MIN_COVER:
        return "cannot tell", resolution_mm
    if n_peaks > 1:
        return "two or more", resolution_mm
    drawn_out = any(long > limit * short for long, short in axes_mm)
    shallow = peak_mm < MIN_COUNT_DEPTH_MM
    return "cannot tell" if drawn_out or shallow else "one", resolution_mm


def _principal_axes_mm(mask: Array, depth: Depth, share: float) -> tuple[float, float]:
    """Standard deviations, long and short, of the depth below a share of a region's peak."""
    inner = np.where(mask, depth.depth_mm, 0)
    base = share * inner.max()
    parts = _label_parts(inner >= base)
    rows, columns = np.nonzero(parts == parts.flat[inner.argmax()])
    weights = inner[rows, columns] - base + 1e-9 * base  # a region may be of one point
    variance = np.cov(rows, columns, aweights=weights, ddof=0) + np.eye(2) / 12  # of a cell
    short, long = depth.cell_mm * np.sqrt(np.linalg.eigvalsh(variance))
    return float(long), float(short)


def _outline(mask: Array, depth: Depth) -> Array:
    """Outer edge of a region, (n, 2) mm, finer than the points' spacing."""
    times = max(1, round(depth.cell_mm / OUTLINE_CELL_MM))
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    first = np.array([columns[0], rows[0]])
    inner = mask[first[1] : rows[-1] + 1, first[0] : columns[-1] + 1]
    padded = np.pad(inner.astype(np.float32), 2)  # as far as the blur reaches
    fine = cv2.resize(padded, None, fx=times, fy=times, interpolation=cv2.INTER_LINEAR)
    smooth = cv2.GaussianBlur(fine, (0, 0), times / 2) >= 0.5
    edges, _ = cv2.findContours(smooth.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    edge = max(edges, key=len)[:, 0, :]
    points = (edge + 0.5) / times - 0.5 - 2 + first  # of the map's points
    return np.asarray([depth.x_mm[0], depth.y_mm[0]] + points * depth.cell_mm)


def _pressure_shares(traction: TractionField, labels: Array, depth: Depth) -> Array:
    """Share of the pressure by label; each cell's pressure counts for the nearest contact."""
    from scipy import ndimage

    pressure = np.maximum(-traction.traction_mpa[..., 2], 0)
    shares = np.zeros(int(labels.max()) + 1)
    if not labels.any() or not pressure.any():
        return shares
    to = ndimage.distance_transform_edt(labels == 0, return_distances=False, return_indices=True)
    near = labels[tuple(to)]
    column, row = (
        np.clip(np.rint((positions - axis[0]) / depth.cell_mm).astype(int), 0, len(axis) - 1)
        for positions, axis in ((traction.x_mm, depth.x_mm), (traction.y_mm, depth.y_mm))
    )
    np.add.at(shares, near[np.ix_(row, column)], pressure / pressure.sum())
    return shares
