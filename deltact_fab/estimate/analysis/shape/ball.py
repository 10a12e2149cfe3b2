"""Depth calibration on presses of a ball, from its radius, the stage's positions and images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.bench import open_run
from deltact_fab.common import InputError

from ...measure.face import FaceFlow
from ...measure.force.calibration import load_force
from ...measure.sensor_id import CalibrationHead, require_same_sensor
from ...measure.shape.depth import DepthFinder, DepthModel, ball_depth_mm
from ..flows import settled_flows
from ..runs import fitted_rows, head_of, read_frames, sensor_of, settled_rows, view_of_run

# Share of a press's depth below which the ball certainly touches; by hand, above the rim's 0.3.
SURE_CONTACT_SHARE = 0.4
MIN_PRESS_MM = 0.3  # of a calibration; by hand: less is small against noise and the smoothing
MIN_DEPTH_COVER = 0.7  # tracked share of the view; by hand, as MIN_FORCE_COVER
# A gain outside [1/2, 2] is doubtful, outside [1/3, 3] refused; by hand: on other gels, 1.08 to
# 1.31 was measured (docs/evidence/strangers.md).
DOUBTFUL_GAIN, MAX_DEPTH_GAIN = 2.0, 3.0


@dataclass(frozen=True)
class DepthCalibration:
    """A model of the depth and its source.

    diameter_mm: of the ball. depths_mm: of the stops. error_mm: mean distance
    to the ball over the points that certainly touch, in the calibration's own frames. dragged:
    number of stops not used, as the ball was dragged along the face.
    """

    head: CalibrationHead
    model: DepthModel
    diameter_mm: float
    depths_mm: list[float]
    error_mm: float
    dragged: int

    def as_dict(self) -> dict[str, Any]:
        tables = {"depth": self.model.as_dict(), "ball": self._ball()}
        return {**tables, "doubt": self.doubt, "dragged": self.dragged}

    def toml(self) -> str:
        return self.head.toml({"depth": self.model.as_dict(), "ball": self._ball()})

    @property
    def line(self) -> str:
        model = self.model
        return (
            f"Depth calibrated on a sphere of {self.diameter_mm:g} mm at "
            f"{', '.join(dict.fromkeys(f'{d:.2f}' for d in self.depths_mm))} mm: "
            f"gain {model.gain:.3f}; "
            f"mean error {self.error_mm:.3f} mm where the sphere certainly touches "
            f"({self.head.origin})."
            + (f"\n{self.dragged} stops not used: dragged along the face" if self.dragged else "")
            + (f"\nDoubtful: {self.doubt}" if self.doubt else "")
        )

    @property
    def doubt(self) -> str | None:
        """Reason to doubt the gain, None without one."""
        reasons = []
        if not 1 / DOUBTFUL_GAIN <= self.model.gain <= DOUBTFUL_GAIN:
            reasons.append(
                f"gains are usually between {1 / DOUBTFUL_GAIN:g} and {DOUBTFUL_GAIN:g}; check the "
                "sphere's diameter, the stage's zero at the face and the skin's thickness"
            )
        if max(self.depths_mm) - min(self.depths_mm) < MIN_PRESS_MM:
            reasons.append(
                "one depth says nothing of others; stops at least "
                f"{MIN_PRESS_MM} mm apart are needed"
            )
        return "; ".join(reasons) or None

    def _ball(self) -> dict[str, Any]:
        return {
            "diameter_mm": self.diameter_mm,
            "depths_mm": [round(depth, 4) for depth in self.depths_mm],
            "error_mm": round(self.error_mm, 4),
        }


def calibrate_depth(folder: str | Path, force: Path | None = None) -> DepthCalibration:
    """Calibrate depth on the presses of a run's first ball, by their stops without a drag.

    force: a force calibration, whose gel replaces the design's: a measurement that uses both then
    inverts the face once.

    Uses the images and stage positions of the settled frames and the ball's diameter, of presses of
    role "fit". Raises InputError for a run that is unfinished, has no images or no ball pressed
    0.3 mm deep.
    """
    run = open_run(folder)
    frames = read_frames(run, "shape")
    balls = fitted_rows(run, frames[frames["indenter"].str.startswith("sphere:")])
    if balls.empty:
        names = ", ".join(dict.fromkeys(frames["indenter"]))
        raise InputError(
            f"{folder}: no press of a sphere in this run (indenters: {names}) has the role 'fit'; "
            "depth calibration needs one, as in the protocol 'ball-press'"
        )
    ball = str(balls["indenter"].iloc[0])
    diameter_mm = float(ball.removeprefix("sphere:"))
    view = view_of_run(run)
    if force is not None:
        calibration = load_force(force)
        require_same_sensor(calibration.head, sensor_of(run), str(force))
        view = calibration.view(view)
    finder = DepthFinder(view, DepthModel(gain=1.0, deepest_mm=MIN_PRESS_MM))
    parts, depths, dragged = [], [], 0
    for press in dict.fromkeys(balls.loc[balls["indenter"] == ball, "press"]):
        rows = settled_rows(run.frames(press))
        flows = settled_flows(run, press, FaceFlow.SPACING_PX)
        tips = rows[["x_mm", "y_mm", "z_mm"]].to_numpy(float)
        dragged += int((rows["kind"] == "shear").sum())
        for kind, tip, flow in zip(rows["kind"], tips, flows, strict=True):
            covered = flow.trusted and flow.cover >= MIN_DEPTH_COVER
            if kind == "shear" or not (-tip[2] >= MIN_PRESS_MM and covered):
                continue
            expected = ball_depth_mm(flow, view, tip, diameter_mm / 2)
            touching = (expected > -SURE_CONTACT_SHARE * tip[2]) & flow.known
            measured = finder.find(flow).depth_mm
            parts.append(np.stack((measured[touching], expected[touching])))
            depths.append(-float(tip[2]))
    measured, expected = np.concatenate(parts, axis=1) if parts else np.zeros((2, 0))
    if not measured.any():
        raise InputError(
            f"{folder}: {ball}: no undragged stop {MIN_PRESS_MM} mm deep or more and with a "
            "trusted flow"
        )
    gain = float(measured @ expected / (measured @ measured))
    if not 1 / MAX_DEPTH_GAIN <= gain <= MAX_DEPTH_GAIN:
        raise InputError(
            f"{folder}: {ball}: the measured depth is {1 / gain:.2g} times the sphere's; "
            "check its diameter and the stage's zero at the face"
        )
    return DepthCalibration(
        head_of([run], "depth"),
        DepthModel(gain, max(depths), view.poisson, view.skin.thickness_mm), diameter_mm, depths,
        float(np.abs(gain * measured - expected).mean()), dragged,
    )  # fmt: skip
