"""Depth calibrated on one press of a ball: its radius, where the stage had it, and the images."""

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
from ..runs import head_of, read_frames, sensor_of, settled_frames, view_of_run

SURE_CONTACT_SHARE = 0.4
"""Of the press's depth: points of the ball that lie deeper certainly touch, the rim lies higher."""
MIN_PRESS_MM = 0.3
"""Of a press that says enough."""
MIN_DEPTH_COVER = 0.7
DOUBTFUL_GAIN, MAX_DEPTH_GAIN = 2.0, 3.0
"""Or one over it: beyond, it is hardly, and not, the gel that differs."""


@dataclass(frozen=True)
class DepthCalibration:
    """A model of the depth and what it was made from.

    diameter_mm: of the ball. depths_mm: of the presses, frame by frame. error_mm: mean distance
    to the ball over the points that certainly touch, of these frames themselves.
    """

    head: CalibrationHead
    model: DepthModel
    diameter_mm: float
    depths_mm: list[float]
    error_mm: float

    def as_dict(self) -> dict[str, Any]:
        return {"depth": self.model.as_dict(), "ball": self._ball(), "doubt": self.doubt}

    def toml(self) -> str:
        return self.head.toml({"depth": self.model.as_dict(), "ball": self._ball()})

    @property
    def line(self) -> str:
        model = self.model
        return (
            f"Depth calibrated on a sphere of {self.diameter_mm:g} mm at "
            f"{', '.join(f'{depth:.2f}' for depth in self.depths_mm)} mm: gain {model.gain:.3f}; "
            f"mean distance to the sphere {self.error_mm:.3f} mm where it certainly touches "
            f"({self.head.origin})." + (f"\nDoubtful: {self.doubt}" if self.doubt else "")
        )

    @property
    def doubt(self) -> str | None:
        """What speaks against it, if anything does."""
        if 1 / DOUBTFUL_GAIN <= self.model.gain <= DOUBTFUL_GAIN:
            return None
        return (
            f"a gain between {1 / DOUBTFUL_GAIN:g} and {DOUBTFUL_GAIN:g} is usual; are the sphere's "
            "diameter, where the stage has the face, and the skin's thickness right?"
        )

    def _ball(self) -> dict[str, Any]:
        return {
            "diameter_mm": self.diameter_mm,
            "depths_mm": [round(depth, 4) for depth in self.depths_mm],
            "error_mm": round(self.error_mm, 4),
        }


def calibrate_depth(folder: str | Path, force: Path | None = None) -> DepthCalibration:
    """Calibrate depth on a run in which a ball presses the face, by its first press of one.

    force: a calibration of it, whose gel is taken instead of the design's: a measurement that uses
    both then inverts the face once.

    Takes the settled frames and nothing but images, poses and the ball's diameter. Raises
    InputError for a run that is not finished, has no images or presses no ball, or not 0.3 mm deep.
    """
    run = open_run(folder)
    frames = read_frames(run, "shape")
    balls = frames[frames["indenter"].str.startswith("sphere:")]
    if balls.empty:
        names = ", ".join(dict.fromkeys(frames["indenter"]))
        raise InputError(
            f"{folder}: no sphere presses in this run (it has {names}); depth is calibrated on a "
            "press of a sphere, as in the protocol 'ball-press'"
        )
    press = str(balls["press"].iloc[0])
    diameter_mm = float(str(balls["indenter"].iloc[0]).removeprefix("sphere:"))
    view = view_of_run(run)
    if force is not None:
        calibration = load_force(force)
        require_same_sensor(calibration.head, sensor_of(run), str(force))
        view = calibration.view(view)
    finder = DepthFinder(view, DepthModel(gain=1.0, deepest_mm=MIN_PRESS_MM))
    parts, depths = [], []
    rows = settled_frames(run.frames(press))
    tips = rows[["x_mm", "y_mm", "z_mm"]].to_numpy(float)
    for tip, flow in zip(tips, settled_flows(run, press, FaceFlow.SPACING_PX), strict=True):
        if not (-tip[2] >= MIN_PRESS_MM and flow.trusted and flow.cover >= MIN_DEPTH_COVER):
            continue
        expected = ball_depth_mm(flow, view, tip, diameter_mm / 2)
        touching = (expected > -SURE_CONTACT_SHARE * tip[2]) & flow.known
        measured = finder.find(flow).depth_mm
        parts.append(np.stack((measured[touching], expected[touching])))
        depths.append(-float(tip[2]))
    measured, expected = np.concatenate(parts, axis=1) if parts else np.zeros((2, 0))
    if not measured.any():
        raise InputError(
            f"{folder}: press {press}: no frame in which the sphere is {MIN_PRESS_MM} mm deep or more "
            "and the flow is trusted"
        )
    gain = float(measured @ expected / (measured @ measured))
    if not 1 / MAX_DEPTH_GAIN <= gain <= MAX_DEPTH_GAIN:
        raise InputError(
            f"{folder}: press {press}: the depth found is {1 / gain:.2g} times the sphere's; is "
            "its diameter, or where the stage has the face, wrong?"
        )
    return DepthCalibration(
        head_of([run], "depth"),
        DepthModel(gain, max(depths), view.poisson, view.skin.thickness_mm), diameter_mm, depths,
        float(np.abs(gain * measured - expected).mean()),
    )  # fmt: skip
