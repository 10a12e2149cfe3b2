"""`study run shapes`: the paper's Shape Reconstruction and its figure of the force distribution.

Sphere, cylinder, ring and toy hat, pressed on the virtual rig: the paper's gallery, depth errors,
and the force field of a sheared press. `analyze shape` plots a recorded run. First calibrations of
depth (a press of a ball) and of force (that ball at three places); then the objects, none of which
is that ball, and the ball of the twist.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import pandas as pd

from deltact_fab.bench import Protocol, RunEstimate, load_protocol
from deltact_fab.estimate import (
    Interval,
    PressShape,
    ShapeMaps,
    ShapeResult,
    fit_model,
    gather_points,
)
from deltact_fab.present import (
    Headline,
    ReportFigure,
    ReportTable,
    StudyResult,
    plot_depth_against_truth,
    plot_distribution,
    plot_gallery,
)

from . import press_jobs as jobs
from .registry import StudyRequest, modulus_remark, parse_scale
from .scene import PressScene, collect_left_out

OBJECT_SETS = ("shapes", "shapes-hat")
"""Protocols of the four objects."""
BALL_PRESS, FORCE_SMALL, TWIST_PRESS = "ball-press", "force-calibration-small", "twist"
ALL_SETS = (*OBJECT_SETS, BALL_PRESS, FORCE_SMALL, TWIST_PRESS)
FORCE_INDENTER = "sphere:10"
"""Indenter of the force calibration; as for depth, and none of the objects."""
FORCE_MODEL = "inverse-placed"
"""Chosen by `calibrate force` on every run so far (decision 0026); it gives a force field."""
NINE_D_TACT = (
    "9DTact reports 0.0462 mm for one ball (arXiv 2308.14277): another, real sensor and another "
    "experiment"
)
SHAPES_GOAL_N = 0.2  # decision 0038: as in the force calibration
PRESSURE_GOAL = 0.3  # by hand: mean error over the contact, relative to the peak pressure
MEAN_COLUMNS = (
    "depth_error_contact_mm", "depth_error_face_mm", "true_peak_depth_mm", "peak_depth_mm",
    "true_area_mm2", "area_mm2", "contact_iou", "normal_n", "found_normal_n", "true_peak_kpa",
    "peak_kpa",
)  # fmt: skip
"""Columns of the table, if known."""
SHAPES_NOTES = (
    "The paper shows these shapes without numbers to compare with, and without sizes, positions or "
    "depths. Its density shows outlines and edges, and off the axis a shift by parallax: it is not "
    "a depth map.",
    "A three-axis stage cannot rotate: the twist is a ball sheared far from the centre.",
)


def run(request: StudyRequest) -> StudyResult:
    """Run the study, calibrations first. Raises InputError, RunFailed."""
    scene = load_scene(request)
    scene.solve_gels(request)
    ball = scene.presses(BALL_PRESS)[0]
    depth_job = scene.job("depth", BALL_PRESS, ball, jobs.depth_calibration_job, jobs.PressJob)
    work, kind, features = jobs.force_points_job, jobs.ForcePointsJob, (FORCE_MODEL,)
    force_jobs = [
        scene.job(f"force {press}", FORCE_SMALL, press, work, kind, features=features)
        for press in scene.presses(FORCE_SMALL)
    ]
    first = request.solve([depth_job, *force_jobs])
    depth, points = first[depth_job.name], [first[job.name] for job in force_jobs]
    parts = [value["points"] for value in points]
    data = gather_points(parts, [FORCE_MODEL], scene.view(FORCE_SMALL), FORCE_SMALL)
    model, errors = fit_model(data, FORCE_MODEL, scene.seed)
    force = scene.calibration(FORCE_SMALL, model, errors)
    texts = {"depth": depth["toml"], "force": force.toml("")}
    shape_jobs = [
        (name, scene.job(f"{name} {press}", name, press, jobs.shape_job, jobs.ShapeJob, **texts))
        for name in (*OBJECT_SETS, TWIST_PRESS)
        for press in scene.presses(name)
    ]
    shapes = request.solve([job for _, job in shape_jobs]).results
    finished = [(name, job.name) for name, job in shape_jobs if job.name in shapes]
    objects = {job: shapes[job]["shape"] for name, job in finished if name != TWIST_PRESS}
    twist = next((shapes[job]["shape"] for name, job in finished if name == TWIST_PRESS), None)
    pictures = PressShape.deepest_maps(objects.values())
    gel = [depth, *points, *shapes.values()]
    modulus_mpa = scene.protocols[BALL_PRESS].specimen.modulus_mpa
    return build_result(
        objects,
        pictures,
        next((p for p in (twist and twist.twisted, *pictures) if p and p.tractions), None),
        f"simulated on {scene.rig_name}, seed {request.seed}",
        errors.get("normal", {}).get("rmse_left_out_position_n"),
        (depth["line"], modulus_remark(modulus_mpa)),
        simulated=True,
        seed=request.seed,
        scale=parse_scale(request.scale),
        settings=settings(scene, gel),
        left_out=collect_left_out(gel),
        more={"twist": twist.rows if twist else []},
    )


def load_scene(request: StudyRequest) -> PressScene:
    """Load the requested scene. Raises InputError, one line, for an unusable one."""
    scale = parse_scale(request.scale)
    protocols = {}
    for name in ALL_SETS:
        protocol, source = load_protocol(name)
        if name == FORCE_SMALL:
            protocol = protocol.narrowed(tips=[FORCE_INDENTER])
        elif name in (*OBJECT_SETS, TWIST_PRESS):
            places = protocol.places_mm
            count = 1 if name == TWIST_PRESS else max(1, round(scale * len(places)))
            protocol = protocol.narrowed(places_mm=places[:count])
        protocols[name] = protocol, source
    return PressScene.load(request, protocols)


def settings(scene: PressScene, gel: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Settings of the presses in words."""
    box = scene.rig.stage
    first, hat, ball, force, _ = (scene.protocols[name] for name in ALL_SETS)
    return {
        "objects": "; ".join(f"{', '.join(p.tips)} to {_depths(p)} mm" for p in (first, hat)),
        "places": f"{'; '.join(f'({x:g}, {y:g})' for x, y in first.places_mm)} mm",
        "depth calibrated on": f"{ball.tips[0]} at {_depths(ball)} mm (protocol {BALL_PRESS})",
        "force calibrated on": f"{', '.join(force.tips)}, {len(force.places_mm)} positions"
        f", {RunEstimate.from_protocol(force, 0, box).settled} settled points (of {FORCE_SMALL}); "
        f"model {FORCE_MODEL}",
        **scene.settings(gel),
    }


def _depths(protocol: Protocol) -> str:
    return ", ".join(f"{depth:g}" for depth in protocol.stops_mm)


def build_result(
    presses: Mapping[str, PressShape], pictures: Sequence[ShapeMaps], field: ShapeMaps | None,
    note: str, left_out_n: float | None = None, notes: tuple[str, ...] = (), **metadata: Any,
) -> StudyResult:  # fmt: skip
    """Build the result. presses: by name. pictures: of the gallery. field: a frame with tractions.

    note: origin, above the figures. left_out_n: error of the force calibration on a place left out,
    N. metadata: seed, settings and further fields.
    """
    frames = settled_frames(presses)
    sources = sorted({shape.contact_by for shape in presses.values() if shape.contact_by})
    return StudyResult(
        study="shapes",
        title="Shapes and force distribution",
        headlines=headlines(frames, left_out_n),
        tables=(
            ReportTable(
                "shapes-by-object",
                "By object and depth. Means over the positions of each object. Contact: true (from "
                "depth or pressure) and measured; iou: intersection over union of both.",
                by_object(frames),
            ),
        ),
        figures=build_figures(pictures, field, note),
        notes=(*SHAPES_NOTES, *notes),
        extra={
            "frames": ReportTable("frames", "", frames).records,
            "contact_by": sources,
            **metadata.pop("more", {}),
        },
        **metadata,
    )  # fmt: skip


def settled_frames(presses: Mapping[str, PressShape]) -> pd.DataFrame:
    """Table of settled frames in contact; columns as the rows of `PressShape`, and `job`."""
    rows = [
        {"job": job, **row}
        for job, shape in presses.items()
        for row in shape.rows
        if row["tip_depth_mm"] > 0
    ]
    return pd.DataFrame(rows).dropna(axis="columns", how="all")


def by_object(frames: pd.DataFrame) -> pd.DataFrame:
    """Means over places per object and depth, before any shear, of known values."""
    presses = frames[frames["kind"] != "shear"]
    presses = presses.assign(tip_depth_mm=presses["tip_depth_mm"].round(2))
    grouped = presses.groupby(["indenter", "tip_depth_mm"], sort=False)
    table = grouped[[name for name in MEAN_COLUMNS if name in frames]].mean()
    table.insert(0, "places", grouped["job"].nunique())
    return table.reset_index()


def headlines(frames: pd.DataFrame, left_out_n: float | None = None) -> tuple[Headline, ...]:
    """Headlines; intervals over objects, which differ most, or the places of one object."""
    heads: list[Headline] = []
    if "depth_error_contact_mm" in frames:
        heads += _depth_heads(frames.dropna(subset=["depth_error_contact_mm"]))
    if {"found_normal_n", "normal_n"} <= set(frames.columns):
        heads += _force_heads(frames.dropna(subset=["found_normal_n", "normal_n"]), left_out_n)
    if "pressure_error" in frames:
        part = frames.dropna(subset=["pressure_error"])
        label = "pressure field, mean error over the contact, relative to its peak"
        remark = "cells of 1 mm smooth edges: at hard edges the error is underestimated"
        heads += [_mean_head(label, "", part, "pressure_error", goal=PRESSURE_GOAL, remark=remark)]
    return tuple(heads)


def _depth_heads(frames: pd.DataFrame) -> list[Headline]:
    zero, correlation = frames["zero_error_contact_mm"].mean(), frames["depth_correlation"].mean()
    label = "depth over the contact, mean error"
    return [
        _mean_head(
            label, "mm", frames, "depth_error_contact_mm",
            goal=ShapeResult.GOALS["depth_error_contact_mm"],
            remark=f"baseline (zero depth): {zero:.2f} mm", told=True,
        ),
        _mean_head(
            "depth over the face, mean error", "mm", frames, "depth_error_face_mm", told=True,
            goal=ShapeResult.GOALS["depth_error_face_mm"],
            remark="optimistic, since most of a face is not pressed",
        ),
        *(
            _mean_head(f"{name}: {label}", "mm", part, "depth_error_contact_mm",
                  remark=NINE_D_TACT if str(name).startswith("sphere:") else "")
            for name, part in frames.groupby("indenter", sort=False)
        ),
        _mean_head(
            "the paper's density: correlation with the true depth", "",
            frames.dropna(subset=["relative_correlation"]), "relative_correlation",
            scale="correlation", better="high", remark=f"our depth: {correlation:.2f}", told=True,
        ),
    ]  # fmt: skip


def _force_heads(frames: pd.DataFrame, left_out_n: float | None) -> list[Headline]:
    """Headlines of the normal force error, within the calibrations and extrapolated."""
    remark = "" if left_out_n is None else f"{left_out_n:.2f} N on an unseen position of its ball; "
    heads = []
    outside = frames["force_extrapolated"].astype(bool) | frames["extrapolated"].astype(bool)
    for outer, part in frames.groupby(outside):
        error, true = part["found_normal_n"] - part["normal_n"], part["normal_n"]
        heads.append(
            Headline.from_interval(
                f"normal force {'beyond' if outer else 'within'} the calibrations, RMSE", "N",
                Interval.rmse(error, *_groups(part)), goal=None if outer else SHAPES_GOAL_N,
                remark=f"{'' if outer else remark}forces of {true.min():.1f} to {true.max():.1f} "
                f"N; mean error {100 * (error / true).mean():+.0f} %", told=not outer,
            )
        )  # fmt: skip
    return heads


def _mean_head(
    label: str, unit: str, rows: pd.DataFrame, column: str, scale: Any = "positive", **fields: Any
) -> Headline:
    interval = Interval.mean(rows[column], *_groups(rows), scale)
    return Headline.from_interval(label, unit, interval, **fields)


def _groups(rows: pd.DataFrame) -> tuple[list[str], str]:
    """Groups of frames with correlated errors, and their noun."""
    column, noun = ("indenter", "object") if rows["indenter"].nunique() > 1 else ("job", "place")
    return list(rows[column]), noun


def build_figures(
    pictures: Sequence[ShapeMaps], field: ShapeMaps | None, note: str
) -> tuple[ReportFigure, ...]:
    """Figures: the gallery; depth against truth and forces, if known."""
    charts = []
    if pictures:
        charts.append(
            ReportFigure(
                "shapes-gallery",
                "The paper's gallery: object; camera image with flow; Gaussian density (3 px), red "
                "for deeper; measured face, deepest upwards.",
                partial(plot_gallery, pictures, note),
            )
        )
    if any(picture.true_depth_mm is not None for picture in pictures):
        charts.append(
            ReportFigure(
                "shapes-depth-error",
                "Above: sections through the tip. Below: measured minus true depth; contact "
                "measured (black) and true (dashed).",
                partial(plot_depth_against_truth, pictures, note),
            )
        )
    if field is not None:
        charts.append(
            ReportFigure(
                "force-distribution",
                "The paper's force distribution: flow, normal force and shear, contact in white; "
                "below: true values, if known.",
                partial(plot_distribution, field, note),
            )
        )
    return tuple(charts)
