"""Depth, force and contacts of presses by another solver, seen by a ray tracer.

Calibrated on ten presses, judged on six others; the gel is not the one that the estimators believe
in. The images of the map are the ray tracer's, with a camera's faults on top.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from deltact_fab.common import Array
from deltact_fab.estimate import (
    DepthFinder,
    DepthModel,
    FaceFlow,
    FlowTracker,
    ForceModel,
    make_features,
)

from .. import traced
from ..engine import Case, CurveSetting, Engine, Flagged, Work
from ..image_faults import IMAGE_FAULTS, fault_label, faulty

SPACINGS_PX = (4, 8, 16)  # by hand: around the default, by doubling
FEATURE_SETS = ("sums", "paper", "inverse-placed")
DEFAULT_FEATURES = "inverse-placed"  # definition: what `calibrate force` picks on such presses
BELOW_TIP_SHARE = 0.3  # definition: of a state's deepest point, where its contact ends
STRAIGHT_STATES = slice(None, None, 3)  # by hand: one state a press for depth, straight down
DEEPEST_MM = 2.0  # by hand: above all presses
MAX_SIGMAS = 3.0  # definition: of the rms over the presses calibrated on
MAX_DEPTH_MM = 0.15  # measured, docs/evidence/strangers.md: twice the mean error over the contact


def _finder(presses: traced.TracedPresses) -> DepthFinder:
    """Depth with the gain of the first press."""
    finder = DepthFinder(traced.SENSOR_MODEL, DepthModel(1.0, DEEPEST_MM))
    flow = presses.flow(0)
    truth = presses.interpolate(presses.depth[0], flow.x_mm, flow.y_mm)
    below = truth > BELOW_TIP_SHARE * truth.max()
    depth = finder.find(flow).depth_mm[below]
    gain = float(depth @ truth[below] / (depth @ depth))
    return DepthFinder(traced.SENSOR_MODEL, DepthModel(gain, DEEPEST_MM))


def _test_states(presses: traced.TracedPresses) -> Array:
    return np.flatnonzero(~presses.calibrates)


def depth_error_mm(state: int, flow: FaceFlow, depth_mm: Array) -> float:
    """Mean error over the contact of a state."""
    presses = traced.TracedPresses.load()
    truth = presses.interpolate(presses.depth[state], flow.x_mm, flow.y_mm)
    return float(np.abs(depth_mm - truth)[truth > BELOW_TIP_SHARE * truth.max()].mean())


def _depth(spacing_px: int, scratch: Path) -> Work:
    presses = traced.TracedPresses.load()
    finder, states = _finder(presses), _test_states(presses)[STRAIGHT_STATES]
    flows = [presses.flow(int(k), spacing_px) for k in states]

    def error(depths_mm: list[Array]) -> float:
        states_flows = zip(states, flows, depths_mm, strict=True)
        return float(np.mean([depth_error_mm(k, flow, depth) for k, flow, depth in states_flows]))

    return Work(lambda: [finder.find(flow).depth_mm for flow in flows], error)


def _places(spacing_px: int, scratch: Path) -> Work:
    presses = traced.TracedPresses.load()
    finder, states = _finder(presses), _test_states(presses)[STRAIGHT_STATES]
    flows = [presses.flow(int(k), spacing_px) for k in states]

    def error(regions: list[list[Any]]) -> float:
        places = [r[0].place_mm if r else np.full(2, np.nan) for r in regions]
        return float(np.linalg.norm(places - presses.tip_mm[states, :2], axis=1).mean())

    return Work(lambda: [finder.contacts(flow) for flow in flows], error)


class _Calibration(NamedTuple):
    features: Any
    model: ForceModel
    sigma_n: Array


@functools.cache
def _calibrate(name: str) -> _Calibration:
    presses, features = traced.TracedPresses.load(), make_features(name, traced.SENSOR_MODEL)
    states = np.flatnonzero(presses.calibrates)
    X = np.array([features.compute(presses.flow(int(k))) for k in states])
    wrench = presses.wrench[states]
    model = ForceModel.fit(features, X, wrench)[0]
    errors = []
    for press in np.unique(presses.press[states]):  # left out in turn
        test = presses.press[states] == press
        refit = ForceModel.fit(features, X[~test], wrench[~test])[0]
        errors.append(refit.predict(X[test]) - wrench[test])
    return _Calibration(features, model, np.sqrt((np.concatenate(errors) ** 2).mean(axis=0))[:3])


def _force(name: str, scratch: Path) -> Work:
    presses, (features, model, _) = traced.TracedPresses.load(), _calibrate(name)
    states = _test_states(presses)
    flows = [presses.flow(int(k)) for k in states]

    def run() -> Array:
        return np.array([model.predict(features.compute(flow)[None])[0] for flow in flows])

    def error(wrench: Array) -> float:
        return float(np.sqrt(((wrench - presses.wrench[states])[:, 2] ** 2).mean()))

    return Work(run, error)


def curves() -> Sequence[CurveSetting]:
    """Depth and place by the flow's spacing, force by features."""
    outside = partial(
        CurveSetting, reference="3D solver and ray tracer", reference_error=0.0,
        kind="independent solver",
    )  # fmt: skip
    return [
        *(outside(case, "inverse", f"{n} px", unit, build=partial(build, n),
                  recommended=n == FaceFlow.SPACING_PX)
          for case, unit, build in (("depth below balls", "mm, mean over the contact", _depth),
                                    ("place of contacts", "mm, mean", _places))
          for n in SPACINGS_PX),
        *(outside("normal force of balls", name, "every 8 px", "N rms", build=partial(_force, name),
                  recommended=name == DEFAULT_FEATURES)
          for name in FEATURE_SETS),
    ]  # fmt: skip


# -- the map: images with faults ----------------------------------------------------------------


def _measure(fault: str, strength: float) -> tuple[FaceFlow, bool]:
    """Flow of the pressed image with a fault, and whether the tracker trusts it."""
    rest, pressed = traced.images()
    tracker = FlowTracker()
    tracker.update(rest)
    estimate = tracker.update(faulty(pressed, fault, strength))
    flow = FaceFlow.from_flow(estimate, traced.TRACED_VIEW, FaceFlow.SPACING_PX)
    return flow, estimate.diagnostics.trusted


def _force_cell(fault: str, strength: float, scratch: Path) -> tuple[float, str]:
    """Largest error of the three forces over what the calibration states."""
    presses, (features, model, sigma_n) = traced.TracedPresses.load(), _calibrate(DEFAULT_FEATURES)
    flow, trusted = _measure(fault, strength)
    wrench = model.wrench(features.compute(flow), features.cover(flow))
    error_n = np.abs(wrench.force_n - presses.force_n[presses.imaged])
    note = f"off by {error_n.max():.2g} N, cover {wrench.cover:.2f}"
    if wrench.extrapolated or not trusted:
        raise Flagged(f"flagged: {'extrapolated' if trusted else 'not trusted'}; {note}")
    return float((error_n / sigma_n).max()), note


def _depth_cell(fault: str, strength: float, scratch: Path) -> tuple[float, str]:
    """Mean error of the depth over the contact."""
    flow, trusted = _measure(fault, strength)
    depth = _cached_finder().find(flow)
    error_mm = depth_error_mm(traced.TracedPresses.load().imaged, flow, depth.depth_mm)
    note = f"off by {error_mm:.2g} mm, cover {depth.cover:.2f}"
    if depth.extrapolated or not trusted:
        raise Flagged(f"flagged: {'extrapolated' if trusted else 'not trusted'}; {note}")
    return error_mm, note


@functools.cache
def _cached_finder() -> DepthFinder:
    return _finder(traced.TracedPresses.load())


def extremes() -> Sequence[Case]:
    """Faults of the image by their strength, for force and depth."""
    charts = (
        (f"Force: largest error over the calibration's rms (to {MAX_SIGMAS:g})", "force",
         _force_cell, MAX_SIGMAS, "of its rms"),
        (f"Depth: mean error over the contact, mm (to {MAX_DEPTH_MM:g})", "depth", _depth_cell,
         MAX_DEPTH_MM, "mm"),
    )  # fmt: skip
    return [
        Case(f"{name}, {fault} {strength:g}", "right or refused", partial(check, fault, strength),
             bound, unit, "flagged", (chart, fault_label(fault), str(k)))
        for chart, name, check, bound, unit in charts
        for fault, (_, strengths) in IMAGE_FAULTS.items() for k, strength in enumerate(strengths, 1)
    ]  # fmt: skip


def cases(quick: bool) -> Sequence[Case]:
    """A flow too coarse for the cells of the inverse; a loose camera."""
    return [
        Case("a flow every 32 px: depth", "refused", _coarse, says="mm apart"),
        Case("a face that moves as a whole: contacts", "right", _rigid, 0.0, "contacts"),
    ]


def _coarse(scratch: Path) -> float:
    return float(_cached_finder().find(traced.TracedPresses.load().flow(0, 32)).depth_mm.max())


def _rigid(scratch: Path) -> float:
    presses = traced.TracedPresses.load()
    flow = presses.flow(0)
    rigid = FaceFlow(np.full_like(flow.shift_mm, 0.4), flow.known, flow.x_mm, flow.y_mm)
    return float(len(_cached_finder().contacts(rigid)))


ENGINE = Engine(
    "Depth, force and contacts",
    "Estimates from the motion of the face under balls; truths by another solver and a ray tracer.",
    cases,
    curves,
    extremes,
)
