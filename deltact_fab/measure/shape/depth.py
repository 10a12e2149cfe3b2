"""Depth of the face in mm: what the pressure that the inverse finds does, calibrated on a ball.

Off the axis depth is seen as motion, on it hardly at all, so no local rule tells depth from flow.
The inverse of the face's linear operator does (`force.press`): its traction moves the face in
depth too, too little by 3 to 14 % (docs/evidence/strangers.md); one factor makes it good.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from ... import catalog
from ...aliases import Array
from ...elasticity.block import interpolation
from ..face import FaceFlow, rigid, whole
from ..force import TractionField
from ..force.press import inverse_for
from ..sensor_id import Head, read_calibration
from ..view import SensorView

RIGID = 0.1
BEYOND = 1.1  # of the deepest press of the calibration: deeper ones are extrapolated


@dataclass(frozen=True)
class DepthModel:
    """gain: depth over what the inverse finds. deepest_mm: that the calibration's ball pressed.

    poisson, thickness_mm: of the gel that the inverse took; None: the view's.
    """

    gain: Annotated[float, Ge(0.1), Le(10)]
    deepest_mm: Annotated[float, Gt(0), Le(20)]
    poisson: Annotated[float, Gt(0), Lt(0.5)] | None = None
    thickness_mm: Annotated[float, Gt(0), Le(100)] | None = None

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - read by catalog.validate

    def as_dict(self) -> dict[str, float]:
        """Plain data, for a calibration file."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    def view(self, view: SensorView) -> SensorView:
        """With the gel that the gain belongs to."""
        return view.with_gel(
            self.poisson or view.poisson, self.thickness_mm or view.skin.thickness_mm
        )

    @classmethod
    def load(cls, path: Path) -> tuple[Head, DepthModel]:
        """Of a file that `calibrate depth` wrote. Raises InputError of one line."""
        head, data = read_calibration(path, "depth")
        return head, catalog.validate(cls, data.get("depth", {}), f"{path}: depth")


@dataclass(frozen=True)
class Depth:
    """Depth of the resting face's points into the gel.

    depth_mm (h, w) float32, at least 0; known (h, w) bool, on x_mm (w,), y_mm (h,): as in FaceFlow.
    cover: share of the contact's cells whose motion is known. extrapolated: deeper than the
    calibration was.
    """

    depth_mm: Array
    known: Array
    x_mm: Array
    y_mm: Array
    cover: float
    extrapolated: bool

    @property
    def cell_mm(self) -> float:
        """Distance of neighbouring points."""
        return float(self.x_mm[1] - self.x_mm[0])


class DepthFinder:
    """Finds the depth of one sensor's face."""

    def __init__(self, view: SensorView, model: DepthModel) -> None:
        self.view, self.model = model.view(view), model
        self.inverse = inverse_for(self.view)

    def of(self, flow: FaceFlow) -> Depth:
        """Of a flow, in mm."""
        flow = whole(flow)
        press = self.inverse.of(flow)
        depth = np.maximum(np.float32(self.model.gain) * self.found_mm(flow, press), 0)
        beyond = float(depth.max()) > BEYOND * self.model.deepest_mm
        return Depth(depth, flow.known, flow.x_mm, flow.y_mm, press.cover, beyond)

    def found_mm(self, flow: FaceFlow, press: TractionField) -> Array:
        """Depth (h, w) float32 that linear elasticity gives for a press, at the flow's points."""
        if not press.pressed or is_rigid(flow):
            return np.zeros(flow.known.shape, np.float32)
        onto_y, onto_x = (
            _spline(tuple(knots.tolist()), tuple(points.tolist()))
            for knots, points in (
                (self.inverse.seen_y_mm, flow.y_mm), (self.inverse.seen_x_mm, flow.x_mm),
            )
        )  # fmt: skip
        return np.asarray(onto_y @ self.inverse.sunk_mm(press) @ onto_x.T)


@lru_cache(maxsize=8)
def _spline(knots_mm: tuple[float, ...], points_mm: tuple[float, ...]) -> Array:
    """Matrix (points, knots) of the cubic spline, level beyond the outer knots."""
    knots, points = np.array(knots_mm), np.clip(points_mm, knots_mm[0], knots_mm[-1])
    return interpolation(knots, points).astype(np.float32)


def is_rigid(flow: FaceFlow) -> bool:
    """Whether the view moved as a whole, shifted and turned: as a camera does that is loose.

    So it is if less than RIGID of its motion is left when the best rigid one is taken off.
    """
    if not flow.known.any():
        return False
    *_, left = rigid(flow)
    moved = flow.shift_mm[flow.known].astype(float)
    return bool((left**2).sum() < RIGID**2 * (moved**2).sum())


def ball_mm(flow: FaceFlow, view: SensorView, tip_mm: Array, radius_mm: float) -> Array:
    """Depth (h, w) of the points of a face that a ball presses, 0 where they are not below it.

    tip_mm (3,): of the ball's lowest point, sensor frame. A point is seen along a ray that meets
    the ball at its depth, so both are found together.
    """
    camera = view.camera
    landed = np.stack(np.meshgrid(flow.x_mm, flow.y_mm), axis=-1) + flow.shift_mm
    origin, way = camera.ray(camera.rest_px(landed))
    depth = np.zeros(flow.known.shape)
    for _ in range(12):
        place = origin[..., :2] - way[..., :2] * depth[..., None]
        far2 = ((place - tip_mm[:2]) ** 2).sum(-1)
        below = far2 < radius_mm**2 / 2
        rise = radius_mm - np.sqrt(np.maximum(radius_mm**2 - far2, radius_mm**2 / 2))
        depth = np.where(below, np.maximum(-tip_mm[2] - rise, 0), 0)
    return depth
