"""Separate contacts in a map of depth: where they are, how large, and what each carries."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...aliases import Array
from ...optics import CameraModel
from ..face import FaceFlow, whole
from ..force import TractionField
from .depth import Depth

RIM = 0.3
"""A contact ends where the depth falls below this share of its peak: of balls the rim is there."""
MIN_MM = 0.05
"""A contact's peak is at least this deep; the inverse finds none in noise (`press.FLOOR`)."""
DIP = 0.75
"""Two peaks are two contacts if the depth between them falls below this share of the lower one."""
FINE_MM = 0.08  # of the map on which outlines are drawn


@dataclass(frozen=True)
class ContactRegion:
    """One region of contact.

    area_mm2, centroid_mm (2,), outline_mm (n, 2) closed, anticlockwise as the camera sees it: on
    the resting face, as all maps are. place_mm (2,): where the centroid is now, which after a
    shear is another place. peak_depth_mm: into the gel. force_share: of the whole pressure, None
    without a traction. cover: share of it whose motion is known.
    """

    area_mm2: float
    centroid_mm: Array
    outline_mm: Array
    place_mm: Array
    peak_depth_mm: float
    force_share: float | None
    cover: float


def contacts(
    depth: Depth, flow: FaceFlow, camera: CameraModel, traction: TractionField | None = None
) -> list[ContactRegion]:
    """The contacts of one frame, the deepest first; none at rest.

    flow: the depth was found from it. traction: for the share of the force.
    """
    labels, flow = contact_labels(depth), whole(flow)
    carried = None if traction is None else _carried(traction, labels, depth)
    masks = [labels == k for k in range(1, int(labels.max()) + 1)]
    if not masks:
        return []
    places = _places(masks, depth, flow, camera)
    found = [
        _contact(mask, depth, place, None if carried is None else float(carried[k]))
        for k, (mask, place) in enumerate(zip(masks, places, strict=True), 1)
    ]
    return sorted(found, key=lambda contact: -contact.peak_depth_mm)


def contact_labels(depth: Depth) -> Array:
    """Number of the contact that each point is in, (h, w) int32; 0: in none."""
    peaks = _peaks(depth.depth_mm)
    out = np.zeros(depth.depth_mm.shape, np.int32)
    if not peaks:
        return out
    rows, columns = np.indices(out.shape)
    nearest = np.argmin([(rows - r) ** 2 + (columns - c) ** 2 for r, c in peaks], axis=0)
    for k, at in enumerate(peaks):
        deep = (nearest == k) & (depth.depth_mm >= RIM * depth.depth_mm[at])
        parts = _parts(deep)
        out[parts == parts[at]] = k + 1
    return out


def _peaks(depth_mm: Array) -> list[tuple[int, int]]:
    """Places of the peaks that a dip parts from every deeper one."""
    around = cv2.dilate(depth_mm, np.ones((5, 5), np.uint8))
    highest = (around == depth_mm) & (depth_mm >= MIN_MM)
    rows, columns = np.nonzero(highest)
    order = np.argsort(-depth_mm[rows, columns], kind="stable")
    kept: list[tuple[int, int]] = []
    for row, column in zip(rows[order], columns[order], strict=True):
        parts = _parts(depth_mm >= DIP * depth_mm[row, column])
        if not any(parts[at] == parts[row, column] for at in kept):
            kept.append((int(row), int(column)))
    return kept


def _parts(mask: Array) -> Array:
    """Number of the part of a mask that each point is in, (h, w) int32; parts touch by a side."""
    return cv2.connectedComponents(mask.view(np.uint8), connectivity=4)[1]


def _places(masks: list[Array], depth: Depth, flow: FaceFlow, camera: CameraModel) -> Array:
    """Where the middle of each region is now, (n, 2)."""
    landed, sunk = np.empty((len(masks), 2)), np.empty((len(masks), 1))
    for k, mask in enumerate(masks):
        weight = np.where(mask, depth.depth_mm, 0)
        total = float(weight.sum())
        mean = (weight.sum(0) @ depth.x_mm) / total, (weight.sum(1) @ depth.y_mm) / total
        shift = [float((weight * flow.shift_mm[..., i]).sum()) / total for i in (0, 1)]
        landed[k], sunk[k] = np.add(mean, shift), float((weight**2).sum()) / total
    origin, way = camera.ray(camera.rest_px(landed))  # one call: it is slow for few
    return np.asarray(origin[:, :2] - way[:, :2] * sunk)


def _contact(mask: Array, depth: Depth, place_mm: Array, share: float | None) -> ContactRegion:
    rows, columns = np.nonzero(mask)
    centroid = np.array([depth.x_mm[columns].mean(), depth.y_mm[rows].mean()])
    return ContactRegion(
        float(len(rows)) * depth.cell_mm**2,
        centroid,
        _outline(mask, depth),
        place_mm,
        float(depth.depth_mm[mask].max()),
        share,
        float(depth.known[mask].mean()),
    )


def _outline(mask: Array, depth: Depth) -> Array:
    """The outer edge of a region, (n, 2) mm, finer than the points' distance."""
    times = max(1, round(depth.cell_mm / FINE_MM))
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    first = np.array([columns[0], rows[0]])
    inner = mask[first[1] : rows[-1] + 1, first[0] : columns[-1] + 1]
    wide = np.pad(inner.astype(np.float32), 2)  # as far as the blur reaches
    fine = cv2.resize(wide, None, fx=times, fy=times, interpolation=cv2.INTER_LINEAR)
    smooth = cv2.GaussianBlur(fine, (0, 0), times / 2) >= 0.5
    edges, _ = cv2.findContours(smooth.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    edge = max(edges, key=len)[:, 0, :]
    at = (edge + 0.5) / times - 0.5 - 2 + first  # of the map's points
    return np.asarray([depth.x_mm[0], depth.y_mm[0]] + at * depth.cell_mm)


def _carried(traction: TractionField, labels: Array, depth: Depth) -> Array:
    """Share of the pressure by label; each cell's goes to the contact nearest to it."""
    from scipy import ndimage

    pressure = np.maximum(-traction.traction_mpa[..., 2], 0)
    shares = np.zeros(int(labels.max()) + 1)
    if not labels.any() or not pressure.any():
        return shares
    to = ndimage.distance_transform_edt(labels == 0, return_distances=False, return_indices=True)
    near = labels[tuple(to)]
    column, row = (
        np.clip(np.rint((at - axis[0]) / depth.cell_mm).astype(int), 0, len(axis) - 1)
        for at, axis in ((traction.x_mm, depth.x_mm), (traction.y_mm, depth.y_mm))
    )
    np.add.at(shares, near[np.ix_(row, column)], pressure / pressure.sum())
    return shares
