"""Shape, and force where it is calibrated, of one press's settled frames, against truth."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from deltact_fab.bench import Run, RunTruth, open_run
from deltact_fab.common import Array, InputError
from deltact_fab.sensor import Indenter, LatticeSampler, restore_indenter

from ...measure.face import FaceFlow
from ...measure.force import load_features
from ...measure.force.calibration import ForceCalibration, load_force
from ...measure.force.model import Features, TractionField, Wrench
from ...measure.shape.density import Density, jacobian_density, relative_depth
from ...measure.shape.depth import (
    ContactRegion,
    Depth,
    DepthFinder,
    DepthModel,
    contact_labels,
    find_contacts,
)
from ..flows import MAP_EVERY_PX, settled_flows
from ..runs import settled_rows, view_of_run

TOUCHING_MM = 0.06
"""Distance from the indenter's surface below which a point touches it, where no traction was
recorded; by hand: above the 0.04 mm by which the gel's cells follow the indenter."""
PRESSED_SHARE = 0.01  # of the peak pressure, for contact; by hand: less is smeared by interpolation


def true_shape(
    truth: RunTruth, frame_id: str, flow: FaceFlow, indenter: Indenter, tip_mm: Array
) -> tuple[Array, Array, str]:
    """Depth (h, w) in mm and contact (h, w) bool at a flow's points, and the criterion of contact.

    tip_mm (3,): of the indenter in this frame.
    """
    sampler = LatticeSampler.make(truth.lattice, flow.x_mm, flow.y_mm)
    u_mm = sampler(truth.displacement_mm(frame_id))
    if not truth.tractions:
        points = np.stack(np.meshgrid(flow.x_mm, flow.y_mm), axis=-1) + u_mm[..., :2]
        height = indenter.height_mm(points[..., 0] - tip_mm[0], points[..., 1] - tip_mm[1])
        contact = (u_mm[..., 2] >= tip_mm[2] + height - TOUCHING_MM) & (u_mm[..., 2] < 0)
        return -u_mm[..., 2], contact, "geometry"
    pressure = -truth.traction_mpa(frame_id)[..., 2]
    pressed = _interpolate(flow.x_mm, flow.y_mm, *truth.face_mm(frame_id), pressure)
    return -u_mm[..., 2], pressed > PRESSED_SHARE * max(pressure.max(), 1e-9), "traction"


SAME_DEPTH_MM = 0.01  # depths closer than this are equal; by hand: above a stage's resolution
FORCE_XYZ = ("fx_n", "fy_n", "fz_n")
KPA_PER_MPA = 1e3  # definition
CONTACT_SHARE = 0.05  # of the peak pressure, where the field's error is taken; by hand, as above
NO_PRESSURE_MPA = 1e-6  # peak of an unpressed frame; by hand: above rounding


Lattice = tuple[Array, Array, Array]
"""x_mm, y_mm and the traction (ny, nx, 3) in MPa there."""


@dataclass(frozen=True)
class ShapeMaps:
    """Maps of a frame, measured and true, (h, w) at the flow's points.

    tip_mm (3,): of the indenter, by the stage. relative: see `relative_depth`. force_n (3,),
    torque_z_nmm: by the force sensor. shape: of a custom indenter, as stored in the run. wrench,
    field: by a force calibration, else None. With truth, else None: true_depth_mm, true_contact,
    and, if the run has tractions, true_traction. For frames that are drawn: image (H, W, 3) BGR
    uint8 over edges_mm: left, right, top and bottom as the camera sees it, row 0 at -y.
    """

    indenter: str
    frame_id: str
    tip_mm: Array
    flow: FaceFlow
    density: Density
    relative: Array
    depth: Depth
    contacts: list[ContactRegion]
    field: TractionField | None = None
    wrench: Wrench | None = None
    force_n: Array | None = None
    torque_z_nmm: float | None = None
    shape: dict[str, Any] | None = None
    true_depth_mm: Array | None = None
    true_contact: Array | None = None
    true_traction: Lattice | None = None
    image: Array | None = None
    edges_mm: Array | None = None

    @property
    def indenter_shape(self) -> Indenter:
        return restore_indenter(
            self.indenter, {self.indenter: self.shape} if self.shape else {}, "a picture"
        )

    @property
    def tip_depth_mm(self) -> float:
        """Depth of the tip below the face, 0 above it."""
        return max(0.0, -float(self.tip_mm[2]))

    @property
    def tractions(self) -> list[tuple[str, Lattice]]:
        """The known tractions, each with a label."""
        f = self.field
        estimated = None if f is None else (f.x_mm, f.y_mm, f.traction_mpa)
        lattices = (("found", estimated), ("true", self.true_traction))
        return [(word, lattice) for word, lattice in lattices if lattice is not None]


@dataclass(frozen=True)
class PressShape:
    """Shape measured in the settled frames of one press.

    rows: figures of each frame by name, without unknown ones. deepest: the end of the deepest
    press, before any shear. twisted: the sheared frame of the largest measured torque about z,
    None without one. contact_by: criterion of the true contact.
    """

    rows: list[dict[str, Any]]
    deepest: ShapeMaps | None
    twisted: ShapeMaps | None
    contact_by: str | None

    @staticmethod
    def deepest_maps(presses: Iterable[PressShape]) -> list[ShapeMaps]:
        """The first maps of each indenter at its greatest depth, in order of the indenters."""
        deepest: dict[str, ShapeMaps] = {}
        for maps in (press.deepest for press in presses):
            if maps is not None and maps.tip_depth_mm > 0:
                best = deepest.setdefault(maps.indenter, maps)
                if maps.tip_depth_mm > best.tip_depth_mm + SAME_DEPTH_MM:
                    deepest[maps.indenter] = maps
        return list(deepest.values())


def measure_press(
    folder: str | Path,
    press: str,
    depth: DepthModel | Path,
    force: ForceCalibration | Path | None = None,
) -> PressShape:
    """Measure shape, and force where it is calibrated, of a press of the run in a folder.

    depth, force: calibrations, or their files. Raises InputError for a calibration that this
    version cannot use, and for a frame without a stage position.
    """
    run = open_run(folder)
    rows, truth, view = settled_rows(run.frames(press)), run.truth(), view_of_run(run)
    if (unknown := rows.loc[rows["z_mm"].isna(), "frame_id"]).size:
        raise InputError(
            f"{run.folder}: frame {unknown.iloc[0]}: no stage position recorded; unless weights "
            "were placed by hand, run `record check` to find the damage"
        )
    finder = DepthFinder(view, DepthModel.load(depth)[1] if isinstance(depth, Path) else depth)
    force = load_force(force) if isinstance(force, Path) else force
    features = None
    if force is not None:
        features = load_features(force.model, force.view(view), "force calibration")
    at_deepest, at_twisted = _picture_rows(rows)
    figures: list[dict[str, Any]] = []
    pictures: dict[int, ShapeMaps] = {}
    contact_by = None
    followed = settled_flows(run, press, MAP_EVERY_PX)
    for k, (row, flow) in enumerate(zip(rows.itertuples(), followed, strict=True)):
        maps = _shape_maps(row, flow, finder, features, force)
        indenter = None if row.indenter == Run.UNKNOWN else run.indenter(str(row.indenter))
        if truth is not None and indenter is not None:
            true = true_shape(truth, maps.frame_id, flow, indenter, maps.tip_mm)
            maps, contact_by = replace(maps, true_depth_mm=true[0], true_contact=true[1]), true[2]
        figures.append(
            {"press": press, "indenter": row.indenter, "frame_id": maps.frame_id,
             "kind": row.kind, "x_mm": float(maps.tip_mm[0]), "y_mm": float(maps.tip_mm[1])}
            | _shape_figures(maps) | _truth_errors(maps) | _force_figures(maps, truth)
        )  # fmt: skip
        if k not in (at_deepest, at_twisted):
            continue
        if truth is not None and truth.tractions:
            lattice = *truth.face_mm(maps.frame_id), truth.traction_mpa(maps.frame_id)
            maps = replace(maps, true_traction=lattice)
        image = run.image(str(row.file))
        h, w = image.shape[:2]
        corners = view.camera.rest_mm(np.array([[-0.5, -0.5], [w - 0.5, h - 0.5]]))
        shape = run.meta.get("shapes", {}).get(row.indenter)
        pictures[k] = replace(maps, image=image, edges_mm=corners.T.ravel(), shape=shape)
    twisted = None if at_twisted is None else pictures[at_twisted]
    return PressShape(figures, pictures.get(at_deepest), twisted, contact_by)


def _picture_rows(rows: pd.DataFrame) -> tuple[int, int | None]:
    """Index of the frame at the end of the deepest press, and of the most twisted one."""
    if rows.empty:
        return -1, None
    depth = -rows["z_mm"].to_numpy(float)
    deepest = int(np.argmax(depth > np.nanmax(depth) - SAME_DEPTH_MM))
    torque = rows["tz_nmm"].abs().where(rows["kind"] == "shear").to_numpy(float)
    return deepest, None if np.isnan(torque).all() else int(np.nanargmax(torque))


def _shape_maps(
    row: Any, flow: FaceFlow, finder: DepthFinder, features: Features | None,
    force: ForceCalibration | None,
) -> ShapeMaps:  # fmt: skip
    """Compute the maps of a frame from its row and its flow."""
    camera, press, depth = finder.view.camera, finder.inverse.solve(flow), finder.find(flow)
    density = jacobian_density(flow, camera.mm_per_px)
    field = wrench = None
    regions = find_contacts(depth, flow, camera, press)
    if features is not None and force is not None:
        wrench = force.model.wrench(features.compute(flow), flow.cover)
        if features.local:
            field = features.traction(flow, force.model)
    measured_n = np.array([getattr(row, name) for name in FORCE_XYZ], float)
    return ShapeMaps(
        str(row.indenter), str(row.frame_id), np.array([row.x_mm, row.y_mm, row.z_mm], float),
        flow, density, relative_depth(density, flow), depth, regions,
        field, wrench, measured_n if np.isfinite(measured_n).all() else None,
        None if pd.isna(row.tz_nmm) else float(row.tz_nmm),
    )  # fmt: skip


def _shape_figures(maps: ShapeMaps) -> dict[str, Any]:
    place_error_mm = None  # known of an indenter with one round tip that presses
    tip_mm = maps.tip_mm
    if maps.contacts and maps.indenter.startswith("sphere:") and tip_mm[2] < 0:
        place_error_mm = float(np.linalg.norm(maps.contacts[0].place_mm - tip_mm[:2]))
    return {
        "tip_depth_mm": maps.tip_depth_mm,
        "trusted": maps.flow.trusted,
        "cover": maps.flow.cover,
        "extrapolated": maps.depth.extrapolated,
        "peak_depth_mm": float(maps.depth.depth_mm.max()),
        "n_contacts": len(maps.contacts),
        "contact_count": maps.contacts[0].count if maps.contacts else None,  # of the deepest
        "area_mm2": float(sum(contact.area_mm2 for contact in maps.contacts)),
        "place_error_mm": place_error_mm,
    }


def _truth_errors(maps: ShapeMaps) -> dict[str, Any]:
    """Errors of depth and contact over the tracked points; empty without truth."""
    flow, depth, true_depth_mm = maps.flow, maps.depth, maps.true_depth_mm
    if true_depth_mm is None or maps.true_contact is None:
        return {}
    valid = flow.known
    contact = maps.true_contact & valid
    error = np.abs(depth.depth_mm - true_depth_mm)
    figures: dict[str, Any] = {
        "true_peak_depth_mm": float(true_depth_mm.max()),
        "depth_error_face_mm": float(error[valid].mean()) if valid.any() else None,
    }
    if not contact.any():
        return figures
    detected = (contact_labels(depth) > 0) & valid
    x, y = np.meshgrid(flow.x_mm, flow.y_mm)
    offset = [a[detected].mean() - a[contact].mean() for a in (x, y)] if detected.any() else None
    return figures | {
        "depth_error_contact_mm": float(error[contact].mean()),
        "zero_error_contact_mm": float(true_depth_mm[contact].mean()),
        "relative_correlation": _correlation(maps.relative[valid], true_depth_mm[valid]),
        "depth_correlation": _correlation(depth.depth_mm[valid], true_depth_mm[valid]),
        "contact_iou": float((detected & contact).sum() / (detected | contact).sum()),
        "centroid_error_mm": None if offset is None else float(np.hypot(offset[0], offset[1])),
        "true_area_mm2": float(np.count_nonzero(contact) * flow.cell_mm**2),
    }


def _correlation(a: Array, b: Array) -> float | None:
    if a.std() == 0 or b.std() == 0:
        return None
    return float(np.corrcoef(a, b)[0, 1])


def _force_figures(maps: ShapeMaps, truth: RunTruth | None) -> dict[str, Any]:
    """Force by sensor and by flow, peak pressure, and the pressure field's error against truth."""
    figures: dict[str, Any] = {}
    if maps.force_n is not None:
        x, y, z = map(float, maps.force_n)
        figures |= {"normal_n": -z, "shear_x_n": x, "shear_y_n": y}
    if maps.wrench is not None:
        x, y, z = map(float, maps.wrench.force_n)
        figures |= {"found_normal_n": -z, "found_shear_x_n": x, "found_shear_y_n": y}
        figures["force_extrapolated"] = maps.wrench.extrapolated
    if maps.field is None:
        return figures
    figures["peak_kpa"] = -KPA_PER_MPA * float(maps.field.traction_mpa[..., 2].min())
    if truth is not None and truth.tractions and maps.force_n is not None:
        true_mpa = truth.traction_mpa(maps.frame_id)[..., 2]
        figures["true_peak_kpa"] = -KPA_PER_MPA * float(true_mpa.min())
        figures["pressure_error"] = _pressure_error(maps.field, truth, maps.frame_id)
    return figures


def _pressure_error(field: TractionField, truth: RunTruth, frame_id: str) -> float | None:
    """Mean error of the pressure over the contact, as a share of its peak; None without contact."""
    x, y = truth.face_mm(frame_id)
    pressure = -truth.traction_mpa(frame_id)[..., 2]
    if (peak := pressure.max()) <= NO_PRESSURE_MPA:
        return None
    true = _interpolate(field.x_mm, field.y_mm, x, y, pressure)
    residual = -field.traction_mpa[..., 2] - true
    return float(np.abs(residual[true > CONTACT_SHARE * peak]).mean() / peak)


def _interpolate(x_mm: Array, y_mm: Array, from_x: Array, from_y: Array, values: Array) -> Array:
    """Values (ny, nx) of a lattice at the points of another one, bilinear."""
    from scipy.interpolate import RegularGridInterpolator

    points = np.stack(np.meshgrid(y_mm, x_mm, indexing="ij"), axis=-1)
    interpolated: Array = RegularGridInterpolator((from_y, from_x), values)(points)
    return interpolated
