"""Stored truths from outside: presses of another solver, seen by a ray tracer; corners of boards.

Simulated; written by `benchmarks.traced`. The camera's laws are the ray tracer's own.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import map_coordinates

from deltact_fab.common import Array, Image
from deltact_fab.estimate import FaceFlow, SensorModel
from deltact_fab.paths import asset
from deltact_fab.sensor import Fisheye, Rectified, SensorDimensions, axes_mm

UNIT_MM = 2.5e-4  # definition: of stored displacements
FOCAL_PX = 388.0  # definition: of the ray tracer's lens
LENS_DEPTHS_MM = (0.0, 3.0)  # definition: of the stored points of a lens
NOISE_NODE_PX = 4  # definition: between nodes at which noise is drawn
SHIFT_NOISE_PX = 0.05  # measured, docs/evidence/flow.md: of the tracker, alike over a millimetre


def path() -> Path:
    """File of the stored truths."""
    return asset("traced.npz")


def to_units(mm: Array) -> NDArray[np.int16]:
    """Lengths as they are stored."""
    return np.round(np.asarray(mm) / UNIT_MM).astype(np.int16)


def view_points_mm(sensor: SensorDimensions) -> Array:
    """Grid of points of the view on the face, (n, 2)."""
    half = np.array(sensor.optics.view_mm) / 2
    x, y = (np.linspace(-h, h, n) for h, n in zip(half, (13, 10), strict=True))
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


@functools.cache
def load() -> Mapping[str, Any]:
    """Arrays of the file; head: how they were made."""
    with np.load(path()) as file:
        data = dict(file)
    return data | {"head": json.loads(str(data["head"]))}


@dataclass(frozen=True)
class TracedPresses:
    """Presses of balls, n states; the gel is not the one that the view believes in.

    tip_mm (n, 3), depth positive; force_n, torque_nmm (n, 3) on the sensor. calibrates (n,): of the
    presses to calibrate on. press (n,): a number. shift, depth: stored, on x_mm, y_mm. imaged: the
    state with images.
    """

    tip_mm: Array
    ball_mm: Array
    force_n: Array
    torque_nmm: Array
    calibrates: Array
    press: Array
    shift: Array
    depth: Array
    x_mm: Array
    y_mm: Array
    displacement: Array
    imaged: int

    @classmethod
    def load(cls) -> TracedPresses:
        data = load()
        arrays = {name: data[name] for name in cls.__dataclass_fields__ if name != "imaged"}
        return cls(**arrays, imaged=int(data["imaged"]))

    @property
    def wrench(self) -> Array:
        """Force and torque (n, 6)."""
        return np.column_stack((self.force_n, self.torque_nmm))

    def interpolate(self, stored: Array, x_mm: Array, y_mm: Array) -> Array:
        """Stored lengths (ny, nx[, k]) at other points, in mm."""
        fields = np.moveaxis(np.atleast_3d(stored) * UNIT_MM, -1, 0)
        splines = [RectBivariateSpline(self.y_mm, self.x_mm, field) for field in fields]
        return np.squeeze(np.stack([spline(y_mm, x_mm) for spline in splines], axis=-1))

    def flow(
        self, state: int, spacing_px: int = FaceFlow.SPACING_PX, noise_px: float = SHIFT_NOISE_PX
    ) -> FaceFlow:
        """Flow of a state with a tracker's noise, by the state's seed; every 4 px, or 8, ..."""
        xs, ys = (
            axis[: len(axis) // spacing_px * spacing_px].reshape(-1, spacing_px).mean(1)
            for axis in axes_mm(TRACED_VIEW)
        )
        shift = self.interpolate(self.shift[state], xs, ys)
        n = spacing_px // NOISE_NODE_PX  # noise of one draw, whatever the spacing
        white = np.random.default_rng(state).standard_normal((256, 256, 2))
        smooth = cv2.GaussianBlur(white, (0, 0), 1 / (NOISE_NODE_PX * TRACED_VIEW.mm_per_px))
        smooth = smooth[: len(ys) * n, : len(xs) * n]
        noise = np.asarray(smooth).reshape(len(ys), n, len(xs), n, 2).mean((1, 3))
        shift = shift + noise * (noise_px * TRACED_VIEW.mm_per_px / max(float(noise.std()), 1e-12))
        return FaceFlow(shift.astype(np.float32), np.ones(shift.shape[:2], bool), xs, ys)


def sample(field: Array, px: Array) -> Array:
    """Values (n, k) of a field (h, w, k) at pixels (n, 2), linear between."""
    places = px[:, ::-1].T
    return np.stack(
        [map_coordinates(part, places, order=1) for part in np.moveaxis(field, -1, 0)], -1
    )


@functools.cache
def images() -> tuple[Image, Image]:
    """Images of the face at rest and of the state `imaged`, rectified by the lens's true focus."""
    images = [cv2.imdecode(load()[name], cv2.IMREAD_COLOR) for name in ("rest", "pressed")]
    rest, pressed = (TRACED_VIEW.rectify(np.asarray(image)) for image in images)
    return rest, pressed


TRACED_SENSOR = SensorDimensions()
TRACED_VIEW = Rectified.from_sensor(TRACED_SENSOR, Fisheye(f_px=FOCAL_PX))
SENSOR_MODEL = SensorModel(TRACED_VIEW, TRACED_SENSOR.skin)
