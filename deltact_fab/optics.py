"""Frames: the only module that converts between image, sensor and stage.

A camera looks along +z at the inside of the pattern: image x = +x, image y = +y, no flip. What
draws, records and analyses knows a `CameraModel`; one model draws and rectifies. The one that
exists is a pinhole on the axis, at the paraxial distance through air, acrylic and gel.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from . import catalog
from .errors import InputError, did_you_mean
from .shapes.sensor import N_ACRYLIC, N_SILICONE, SensorDimensions

Array = NDArray[Any]


class CameraModel(Protocol):
    """Where the points of the sensor are in the image. Pixel (0, 0) is the first one's centre."""

    @property
    def width_px(self) -> int: ...
    @property
    def height_px(self) -> int: ...
    @property
    def mm_per_px(self) -> float:
        """Of the resting face, at the image's centre."""

    @property
    def centre_px(self) -> tuple[float, float]:
        """Where the axis meets the image."""

    def project_px(self, xyz_mm: Array) -> Array:
        """Sensor points (..., 3) in mm to image points (..., 2) in px. Raises InputError."""

    def rest_mm(self, px: Array) -> Array:
        """Image points (..., 2) in px to the resting face (..., 2) in mm."""

    def rest_px(self, xy_mm: Array) -> Array:
        """Points of the resting face (..., 2) in mm to image points (..., 2) in px."""

    def axes_mm(self, margin_px: int = 0) -> tuple[Array, Array]:
        """Columns' x (w + 2 margin,) and rows' y (h + 2 margin,) on the resting face, mm."""

    def as_dict(self) -> dict[str, Any]:
        """Plain data for the record, its class under "model"; `camera_from_dict` reads it."""


@dataclass(frozen=True)
class Pinhole:
    """A pinhole at z = -eye_distance_mm, scaled so that the resting face has mm_per_px.

    Pixel (0, 0) is the centre of the first pixel; the axis meets the image's centre.
    """

    mm_per_px: float
    width_px: int
    height_px: int
    eye_distance_mm: float

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - read by catalog.validate

    @classmethod
    def of(cls, sensor: SensorDimensions) -> Pinhole:
        """The camera of a design."""
        o = sensor.optics
        return cls(o.mm_per_px, o.image_width_px, o.image_height_px, sensor.eye_distance_mm)

    @property
    def centre_px(self) -> tuple[float, float]:
        """Where the axis meets the image."""
        return ((self.width_px - 1) / 2, (self.height_px - 1) / 2)

    def project_px(self, xyz_mm: Array) -> Array:
        """Sensor points (..., 3) in mm to image points (..., 2) in px.

        A point at depth w (z = -w) is seen larger by eye / (eye - w). Raises InputError for points
        at or behind the eye.
        """
        scale = self.eye_distance_mm + xyz_mm[..., 2]
        if not np.all(scale > 0):
            raise InputError("a surface point lies at or behind the camera's eye")
        gain = (self.eye_distance_mm / self.mm_per_px) / scale
        cx, cy = self.centre_px
        return np.stack((xyz_mm[..., 0] * gain + cx, xyz_mm[..., 1] * gain + cy), axis=-1)

    def rest_mm(self, px: Array) -> Array:
        """Image points (..., 2) in px to the resting face (..., 2) in mm."""
        return (px - np.asarray(self.centre_px)) * self.mm_per_px

    def rest_px(self, xy_mm: Array) -> Array:
        """Points of the resting face (..., 2) in mm to image points (..., 2) in px."""
        return xy_mm / self.mm_per_px + np.asarray(self.centre_px)

    def axes_mm(self, margin_px: int = 0) -> tuple[Array, Array]:
        """Columns' x (w + 2 margin,) and rows' y (h + 2 margin,) on the resting face, mm."""
        cols, rows = (
            np.arange(-margin_px, n + margin_px) - c
            for n, c in zip((self.width_px, self.height_px), self.centre_px, strict=True)
        )
        return cols * self.mm_per_px, rows * self.mm_per_px

    def as_dict(self) -> dict[str, Any]:
        """Plain data for the record."""
        return {"model": "pinhole", **asdict(self)}


_MODELS: dict[str, type[Pinhole]] = {"pinhole": Pinhole}


def camera_from_dict(data: dict[str, Any], source: str = "camera") -> CameraModel:
    """The model that `as_dict` wrote; one without a name is from when all were pinholes.

    Raises InputError, with the source in front, for an unknown model or values that are not its.
    """
    values = dict(data)
    name = values.pop("model", "pinhole")
    if name not in _MODELS:
        raise InputError(f"{source}: model: {name!r}; {did_you_mean(str(name), _MODELS)}")
    return catalog.validate(_MODELS[name], values, source)


def reached_mm(half_angle_rad: float, air_gap_mm: float, acrylic_mm: float, gel_mm: float) -> float:
    """Radius on the gel's face that a ray leaving the lens at half_angle_rad reaches.

    Snell at plane faces: r = g tan t + sum of d sin t / sqrt(n^2 - sin^2 t) over acrylic and gel.
    """
    s = math.sin(half_angle_rad)
    layers = ((acrylic_mm, N_ACRYLIC), (gel_mm, N_SILICONE))
    behind = sum(d * s / math.sqrt(n**2 - s**2) for d, n in layers)
    return air_gap_mm * math.tan(half_angle_rad) + behind


def half_angle_rad(radius_mm: float, air_gap_mm: float, acrylic_mm: float, gel_mm: float) -> float:
    """Half angle at the lens under which a point of the face is seen; inf when none reaches it.

    Inverse of reached_mm by bisection, to 1e-12 rad; it grows with the angle. radius_mm >= 0.
    """
    low, high = 0.0, math.pi / 2 - 1e-9
    if reached_mm(high, air_gap_mm, acrylic_mm, gel_mm) < radius_mm:
        return math.inf
    while high - low > 1e-12:
        middle = (low + high) / 2
        if reached_mm(middle, air_gap_mm, acrylic_mm, gel_mm) < radius_mm:
            low = middle
        else:
            high = middle
    return high


@dataclass(frozen=True)
class StageFrame:
    """Rigid transform between the sensor frame and the stage's machine frame.

    machine = rotation about z by angle_deg of the sensor point, then the origin added. The stage's
    z points up along the sensor's +z.
    """

    origin_machine_mm: tuple[float, float, float]
    angle_deg: float = 0.0

    def to_machine_mm(self, sensor_mm: tuple[float, float, float]) -> tuple[float, float, float]:
        """A tip position in the sensor frame to machine coordinates."""
        c, s = self._cos_sin()
        x, y, z = sensor_mm
        ox, oy, oz = self.origin_machine_mm
        return (ox + c * x - s * y, oy + s * x + c * y, oz + z)

    def to_sensor_mm(self, machine_mm: tuple[float, float, float]) -> tuple[float, float, float]:
        """Machine coordinates to a tip position in the sensor frame."""
        c, s = self._cos_sin()
        x, y, z = (m - o for m, o in zip(machine_mm, self.origin_machine_mm, strict=True))
        return (c * x + s * y, -s * x + c * y, z)

    def _cos_sin(self) -> tuple[float, float]:
        angle = np.deg2rad(self.angle_deg)
        return float(np.cos(angle)), float(np.sin(angle))


@dataclass(frozen=True)
class SurfaceLattice:
    """A regular lattice of points on the resting face, on which displacements are stored.

    x0_mm, y0_mm: first node; spacing_mm: between nodes; nx, ny: their number.
    """

    x0_mm: float
    y0_mm: float
    spacing_mm: float
    nx: int
    ny: int

    def as_dict(self) -> dict[str, Any]:
        """Plain data for the record."""
        return asdict(self)


@dataclass(frozen=True)
class LatticeSampler:
    """Cubic B-spline interpolation from a lattice to the tensor grid xs x ys, as two matrices.

    The drawing camera and the stored truth both go through it, so they agree to rounding.
    """

    along_x: NDArray[np.float64]  # (len(xs), nx)
    along_y: NDArray[np.float64]  # (len(ys), ny)

    @classmethod
    def make(cls, lattice: SurfaceLattice, xs_mm: Array, ys_mm: Array) -> LatticeSampler:
        """Build the matrices. Raises InputError when a point lies outside the lattice."""
        return cls(
            _spline_matrix(lattice.x0_mm, lattice.spacing_mm, lattice.nx, xs_mm),
            _spline_matrix(lattice.y0_mm, lattice.spacing_mm, lattice.ny, ys_mm),
        )

    def __call__(self, values: Array) -> NDArray[np.float64]:
        """(ny, nx, c) on the lattice to (len(ys), len(xs), c)."""
        columns = [self.along_y @ values[..., c] @ self.along_x.T for c in range(values.shape[-1])]
        return np.stack(columns, axis=-1)

    def at_points(self, values: Array) -> NDArray[np.float64]:
        """(ny, nx, c) on the lattice to (n, c) at the points (xs[i], ys[i]) taken in pairs."""
        return np.einsum("py,yxc,px->pc", self.along_y, values, self.along_x, optimize=True)


def _spline_matrix(x0: float, step: float, n: int, points: Array) -> NDArray[np.float64]:
    """Matrix (len(points), n) of cubic B-spline interpolation with not-a-knot ends."""
    from scipy.interpolate import make_interp_spline

    nodes = x0 + step * np.arange(n)
    if np.min(points) < nodes[0] - 1e-9 or np.max(points) > nodes[-1] + 1e-9:
        raise InputError(
            f"points from {np.min(points):.3f} to {np.max(points):.3f} mm leave the lattice "
            f"{nodes[0]:.3f} to {nodes[-1]:.3f} mm"
        )
    return np.asarray(make_interp_spline(nodes, np.eye(n), k=3)(points))
