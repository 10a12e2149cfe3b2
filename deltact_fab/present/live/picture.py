"""Data of the live page for a result: a coarse map, sparse arrows, outlines, numbers."""

from __future__ import annotations

import base64
from typing import Any

import cv2
import numpy as np

from deltact_fab.common import Array
from deltact_fab.estimate import FaceFlow
from deltact_fab.sensor import CameraModel

from .formatting import as_dict, contact_number
from .session import MeasuredImage

LOST_BYTE = 255  # format of the page's maps: unknown
# By hand: arrows as sparse as in the paper's figure of the force distribution, and the least full
# scale of arrows and maps, so that noise does not fill the page.
ARROW_SPACING_MM, ARROW_SPACING_PX = 1.5, 32.0
MIN_SCALE_MM, MIN_SCALE_PX = 0.05, 1.0
MIN_SCALE_MPA, MIN_SCALE_RELATIVE = 2e-3, 0.02


def page_data(m: MeasuredImage, camera: CameraModel) -> dict[str, Any]:
    """Return the page's data of one result as plain numbers. camera: of the tracked view."""
    result, in_px = m.result, m.motion.in_px
    cx, cy = camera.centre_px
    scale = camera.mm_per_px  # 1 where lengths are in pixels
    entry: dict[str, Any] = {
        **as_dict(m, outlines=True),
        "hz": m.hz,
        "view_mm": [
            (-0.5 - cx) * scale, (camera.width_px - 0.5 - cx) * scale,
            (-0.5 - cy) * scale, (camera.height_px - 0.5 - cy) * scale,
        ],
        "unit": "px" if in_px else "mm",
        "motion": _largest(m),
        "point": trace_point(m),
        "maps": [], "flow": None, "shear": None,
    }  # fmt: skip
    entry["measured_contacts"] = entry["contacts"] is not None
    entry["contacts"] = entry["contacts"] or []
    entry["contact_number"] = contact_number(entry["contacts"])
    f, min_scale, arrow = result.flow, MIN_SCALE_MM, ARROW_SPACING_MM
    if in_px and result.observation is not None:
        f, min_scale, arrow = (
            FaceFlow.from_flow(result.observation, camera, FaceFlow.SPACING_PX),
            MIN_SCALE_PX,
            ARROW_SPACING_PX,
        )
    if f is not None:
        for contact in entry["contacts"]:
            contact["seen_mm"] = _displaced(contact["outline_mm"], f)
        entry["flow"] = _arrows(f.shift_mm, f.known, f.x_mm, f.y_mm, "flow", min_scale, 1,
                               entry["unit"], "displacement", arrow)  # fmt: skip
    if (t := result.traction) is not None:
        entry["shear"] = _arrows(t.traction_mpa[..., :2], None, t.x_mm, t.y_mm, "shear",
                                 MIN_SCALE_MPA, 1e3, "kPa", "shear")  # fmt: skip
        entry["maps"].append(_map(-t.traction_mpa[..., 2], None, t.x_mm, t.y_mm, "pressure",
                                 MIN_SCALE_MPA, 1e3, "kPa"))  # fmt: skip
    if (s := result.shape) is not None:
        if (d := s.depth) is not None:
            entry["maps"].append(_map(d.depth_mm, d.valid, d.x_mm, d.y_mm, "depth", MIN_SCALE_MM, 1,
                                     "mm"))  # fmt: skip
        entry["maps"].append(_map(s.relative, s.density.reliable, s.x_mm, s.y_mm, "relative depth",
                                 MIN_SCALE_RELATIVE, 1, ""))  # fmt: skip
    return entry


def trace_point(m: MeasuredImage) -> tuple[float | None, ...]:
    """Return a point of the traces: time; force in z, x and y, else motion; 1 if trusted."""
    force, t_s = m.result.force, round(m.source.t_s, 4)
    if force is None:
        return (t_s, _largest(m), float(m.result.trusted))
    x, y, z = (None if np.isnan(v) else round(float(v), 4) for v in force.force_n)
    trusted = float(m.result.trusted and not force.extrapolated)
    return (t_s, z, x, y, trusted)


def draw_markers(m: MeasuredImage, tracked: Array) -> Array:
    """Draw the markers' displacement since rest into the tracked image."""
    dots = m.result.markers
    if dots is None:
        return tracked
    annotated, ends = tracked.copy(), dots.position_px[dots.located]
    ways = np.stack((ends - dots.displacement_px[dots.located], ends), axis=1)
    for start, end in ways.round().astype(int).tolist():
        cv2.arrowedLine(annotated, start, end, (77, 225, 255), 1, cv2.LINE_AA)
    return annotated


def _largest(m: MeasuredImage) -> float | None:
    """Largest motion: in px where no scale is known, else in mm."""
    largest = m.motion.largest_px if m.motion.in_px else m.motion.largest_mm
    return None if largest is None else round(largest, 4)


def _arrows(
    vectors: Array, valid: Array | None, x_mm: Array, y_mm: Array, name: str, min_scale: float,
    factor: float, unit: str, words: str, spacing: float = ARROW_SPACING_MM,
) -> dict[str, Any]:  # fmt: skip
    """Sample vectors (h, w, 2) at a spacing; no arrow where they are unknown."""
    stride = max(1, round(spacing / float(x_mm[1] - x_mm[0])))
    rows, columns = (slice((n - 1) % stride // 2, None, stride) for n in (len(y_mm), len(x_mm)))
    part = np.array(vectors[rows, columns], np.float32)
    if valid is not None:
        part[~valid[rows, columns]] = np.nan
    size = np.hypot(part[..., 0], part[..., 1])
    return {
        "name": name, "times": factor, "unit": unit, "words": words,
        "most": max(min_scale, float(np.nanmax(size)) if np.isfinite(size).any() else 0.0),
        "step_mm": float(x_mm[1] - x_mm[0]) * stride,
        "x_mm": np.round(x_mm[columns], 3).tolist(), "y_mm": np.round(y_mm[rows], 3).tolist(),
        "data": _text(part),
    }  # fmt: skip


def _map(
    values: Array, valid: Array | None, x_mm: Array, y_mm: Array, name: str, min_scale: float,
    factor: float, unit: str,
) -> dict[str, Any]:  # fmt: skip
    """Encode values (h, w) as bytes: up to 0 as 0, the largest as 254, unknown as LOST_BYTE."""
    h, w = values.shape
    gone = np.zeros((h, w), bool) if valid is None else ~valid
    clean = np.where(gone, 0, values).astype(np.float32)
    full_scale = max(min_scale, float(clean.max()))
    top = LOST_BYTE - 1
    levels = np.clip(np.rint(clean / full_scale * top), 0, top).astype(np.uint8)
    levels[gone] = LOST_BYTE
    half_x, half_y = float(x_mm[1] - x_mm[0]) / 2, float(y_mm[1] - y_mm[0]) / 2
    return {
        "name": name, "times": factor, "unit": unit, "most": full_scale,
        "width": w, "height": h, "lost": bool(gone.any()), "data": _text(levels),
        "x_mm": [float(x_mm[0]) - half_x, float(x_mm[-1]) + half_x],
        "y_mm": [float(y_mm[0]) - half_y, float(y_mm[-1]) + half_y],
    }  # fmt: skip


def _displaced(points_mm: list[list[float]], flow: FaceFlow) -> list[list[float]]:
    """Move points of the resting face by the flow."""
    column, row = (
        np.clip(np.rint((coordinates - axis[0]) / flow.cell_mm).astype(int), 0, len(axis) - 1)
        for coordinates, axis in zip(np.transpose(points_mm), (flow.x_mm, flow.y_mm), strict=True)
    )
    return np.round(points_mm + flow.shift_mm[row, column], 3).tolist()


def _text(values: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
