"""Shape, depth and contacts of a run's settled frames, against truth where there is one."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import record
from ...jobs import Progress, each
from ...measure.face import FaceFlow
from ...measure.force import TractionField
from ...measure.sensor_id import require_same
from ...measure.shape import (
    Contact,
    Depth,
    DepthFinder,
    DepthModel,
    by_jacobian,
    contact_labels,
    contacts,
    relative_depth,
)
from ...shapes import Indenter
from ...shapes.indenter import parse
from ..flows import flows_of
from ..frames import recorded, settled
from ..view import sensor_of, view_of
from .ball import EVERY_PX
from .result import Picture, ShapeResult
from .truth import TrueShape, true_shape

Array = NDArray[Any]
UNCALIBRATED = DepthModel(gain=1.0, deepest_mm=20.0)


@dataclass(frozen=True)
class _Job:
    folder: str
    press: str
    model: DepthModel


@dataclass(frozen=True)
class _Press:
    rows: list[dict[str, Any]]
    picture: Picture | None
    contact_by: str | None


def analyse(
    folder: str | Path,
    depth: Path | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> ShapeResult:
    """Every settled frame of a run; depth: a calibration of it, else the inverse's own is taken.

    Raises InputError for a run that is not finished or has no images, and for a calibration that
    is none or another sensor's.
    """
    run = record.open(folder)
    frames = recorded(run, "shape")
    model = UNCALIBRATED
    if depth is not None:
        head, model = DepthModel.load(depth)
        require_same(head.sensor, sensor_of(run), str(depth))
    presses = list(dict.fromkeys(frames["press"]))
    jobs = [_Job(str(folder), press, model) for press in presses]
    parts = each(_press, jobs, presses, executor, progress)
    ways = {part.contact_by for part in parts} - {None}
    return ShapeResult(
        rows=[row for part in parts for row in part.rows],
        pictures=[part.picture for part in parts if part.picture is not None],
        calibration=None if depth is None else str(depth),
        contact_by=", ".join(sorted(map(str, ways))) or None,
        simulated=run.simulated,
        seed=int(run.meta["seed"]),
    )


def _press(job: _Job) -> _Press:
    run = record.open(job.folder)
    rows, truth = settled(run.frames(job.press)), run.truth()
    flows = flows_of(run, job.press, EVERY_PX).flows
    view = view_of(run)
    finder = DepthFinder(view, job.model)
    told: list[dict[str, Any]] = []
    picture, way = None, None
    for row, flow in zip(rows.itertuples(), flows, strict=True):
        press = finder.inverse.of(flow)
        depth = finder.of(flow, press)
        field = TractionField(press.traction, press.x_mm, press.y_mm, press.cover)
        found = contacts(depth, flow, view.camera, field)
        density = by_jacobian(flow, view.camera.mm_per_px)
        relative = relative_depth(density, flow)
        tip_mm = np.array([row.x_mm, row.y_mm, row.z_mm], float)
        indenter = parse(str(row.indenter))
        figures: dict[str, Any] = {
            "press": job.press,
            "indenter": row.indenter,
            "frame_id": row.frame_id,
            "tip_depth_mm": max(0.0, -float(tip_mm[2])),
            "trusted": flow.trusted,
            "cover": flow.cover,
            "contact_cover": depth.cover,
            "density_cover": density.cover,
            "extrapolated": depth.extrapolated,
            "peak_depth_mm": float(depth.depth_mm.max()),
            "n_contacts": len(found),
            "area_mm2": sum(contact.area_mm2 for contact in found),
            "place_error_mm": _place_error_mm(indenter, tip_mm, found),
        }
        true = None
        if truth is not None:
            true = true_shape(truth, str(row.frame_id), flow, indenter, tip_mm)
            figures |= _against(true, depth, relative, flow)
            way = true.contact_by
        told.append(figures)
        if picture is None or figures["tip_depth_mm"] >= picture.tip_depth_mm:
            picture = Picture(
                str(row.indenter), str(row.frame_id), figures["tip_depth_mm"], relative, depth,
                density.reliable, [contact.outline_mm for contact in found],
                None if true is None else true.contact,
            )  # fmt: skip
    return _Press(told, picture, way)


def _place_error_mm(indenter: Indenter, tip_mm: Array, found: list[Contact]) -> float | None:
    """From the contact to the axis of an indenter with one round tip that presses."""
    if not found or not indenter.name.startswith("sphere:") or tip_mm[2] >= 0:
        return None
    return float(np.linalg.norm(found[0].place_mm - tip_mm[:2]))


def _against(true: TrueShape, depth: Depth, relative: Array, flow: FaceFlow) -> dict[str, Any]:
    """Errors over known points: of the depth, of where the contact is; None without a contact."""
    contact, known = true.contact & flow.known, flow.known
    error = np.abs(depth.depth_mm - true.depth_mm)
    figures: dict[str, Any] = {
        "true_peak_depth_mm": float(true.depth_mm.max()),
        "depth_error_face_mm": float(error[known].mean()) if known.any() else None,
    }
    if not contact.any():
        return figures
    seen = (contact_labels(depth) > 0) & known
    x, y = np.meshgrid(flow.x_mm, flow.y_mm)
    apart = None
    if seen.any():
        apart = float(np.hypot(*(a[seen].mean() - a[contact].mean() for a in (x, y))))
    return figures | {
        "depth_error_contact_mm": float(error[contact].mean()),
        "depth_bias_contact_mm": float((depth.depth_mm - true.depth_mm)[contact].mean()),
        "zero_error_contact_mm": float(true.depth_mm[contact].mean()),
        "relative_correlation": _correlation(relative[known], true.depth_mm[known]),
        "depth_correlation": _correlation(depth.depth_mm[known], true.depth_mm[known]),
        "contact_iou": np.count_nonzero(seen & contact) / np.count_nonzero(seen | contact),
        "centroid_error_mm": apart,
        "true_area_mm2": np.count_nonzero(contact) * flow.cell_mm**2,
    }


def _correlation(a: Array, b: Array) -> float | None:
    if a.std() == 0 or b.std() == 0:
        return None
    return float(np.corrcoef(a, b)[0, 1])
