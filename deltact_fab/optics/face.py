"""What a tracked view shows of the face while it moves: the truth that an estimate is held against.

Where frames were drawn through another lens than the view was rectified by, what a pixel shows is
what the true lens sees there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..aliases import Array
from .camera import CameraModel, axes_mm
from .fisheye import Fisheye
from .lattice import LatticeSampler, PointSampler, SurfaceLattice
from .rectified import Rectified

STEP_MM = 0.2  # between nodes that a motion is projected at, at most


class FaceMotion:
    """Projected motion on a lattice that has the nodes of the displacement's and some between.

    A frame has a million points to project and a lattice some ten thousand. What is projected is a
    smooth function of the position and of a displacement that is itself a cubic spline on the
    lattice. With nodes at most STEP_MM apart the spline through it is off by 1e-5 px in a drag 3 mm
    deep, by 1e-4 in one 8 mm deep (95th percentile; .002 px at worst).
    """

    def __init__(self, lattice: SurfaceLattice, project_px: Callable[[Array], Array]) -> None:
        """project_px: points of the moved face (..., 3) in mm to the image (..., 2) in px."""
        n = ceil(lattice.spacing_mm / STEP_MM - 1e-9)
        self.lattice = replace(
            lattice,
            spacing_mm=lattice.spacing_mm / n,
            nx=(lattice.nx - 1) * n + 1,
            ny=(lattice.ny - 1) * n + 1,
        )
        # Rounding may put the last node a hair beyond the lattice's.
        xs, ys = (
            np.clip(fine, coarse[0], coarse[-1])
            for fine, coarse in zip(self.lattice.axes_mm(), lattice.axes_mm(), strict=True)
        )
        # The finer spline holds the coarser one: no displacement is changed by this.
        self.displaced = LatticeSampler.make(lattice, xs, ys)
        x, y = np.meshgrid(xs, ys)
        self._rest = np.stack((x, y, np.zeros_like(x)), axis=-1)
        self._project_px = project_px
        self._rest_px = project_px(self._rest)

    def __call__(self, displacement_mm: Array) -> Array:
        """Displacement (ny, nx, 3) on its lattice to motion in px on `lattice`, (ny, nx, 2)."""
        moved = self._rest + self.displaced(displacement_mm)
        return np.asarray(self._project_px(moved) - self._rest_px)


class SeenFace:
    """Motion of the face, (ny, nx, 3) mm on a lattice, as the pixels of a view show it.

    lens: what the frames were drawn through; None: through the camera itself.
    """

    def __init__(
        self, camera: CameraModel, lattice: SurfaceLattice, lens: Fisheye | None = None
    ) -> None:
        self.camera, self.lattice, self.lens = camera, lattice, lens

    def flow_px(self, u_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Projected displacement of what every pixel sees at rest, (h, w, 2) px."""
        return self.both(u_mm)[0]

    def in_plane_mm(self, u_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """In-plane displacement of what every pixel sees at rest, (h, w, 2) mm: not projected."""
        u_mm = u_mm[..., :2]
        return self._grid(u_mm) if self._through is None else self._through.at_rest(u_mm)

    def both(self, u_mm: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """`flow_px` and `in_plane_mm`, for little more than the first."""
        if self._through is not None:
            return self._through.flow_px(u_mm), self._through.at_rest(u_mm[..., :2])
        moved_mm = self._grid(u_mm)
        return self.camera.project_px(self._rest_mm + moved_mm) - self._rest_px, moved_mm[..., :2]

    def points_px(
        self, u_mm: NDArray[np.float64], xy_mm: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Projected displacement (n, 2) px of points of the resting face (n, 2) mm."""
        moved_mm = PointSampler(self.lattice, xy_mm)(u_mm)
        rest_mm = np.column_stack((xy_mm, np.zeros(len(xy_mm))))
        project_px = (self._through or self.camera).project_px
        return np.asarray(project_px(rest_mm + moved_mm) - project_px(rest_mm))

    @cached_property
    def _grid(self) -> LatticeSampler:
        return LatticeSampler.make(self.lattice, *axes_mm(self.camera))

    @cached_property
    def _rest_mm(self) -> NDArray[np.float64]:
        x_mm, y_mm = np.meshgrid(*axes_mm(self.camera))
        return np.stack((x_mm, y_mm, np.zeros_like(x_mm)), axis=-1)

    @cached_property
    def _rest_px(self) -> NDArray[np.float64]:
        return self.camera.project_px(self._rest_mm)

    @cached_property
    def _through(self) -> _Through | None:
        if self.lens is None:
            return None
        assert isinstance(self.camera, Rectified), "a lens's frames are rectified"
        return _Through(self.lens, self.camera, self.lattice)


class _Through:
    """What a rectified view shows of frames that were drawn through another lens than it holds."""

    def __init__(self, lens: Fisheye, view: Rectified, lattice: SurfaceLattice) -> None:
        self._lens, self._view = lens, view
        columns, rows = np.meshgrid(np.arange(view.width_px), np.arange(view.height_px))
        px = np.stack((columns, rows), axis=-1).astype(float)
        seen_mm = lens.rest_mm(view.lens.rest_px(view.rest_mm(px))).reshape(-1, 2)
        self._shape = px.shape
        self._motion = FaceMotion(lattice, self.project_px)
        self._at_seen = PointSampler(self._motion.lattice, seen_mm)

    def project_px(self, xyz_mm: NDArray[Any]) -> NDArray[Any]:
        """Points (..., 3) mm, through the lens, to where the view takes them to be (..., 2) px."""
        return self._view.rest_px(self._view.lens.rest_mm(self._lens.project_px(xyz_mm)))

    def flow_px(self, u_mm: NDArray[Any]) -> NDArray[Any]:
        """Motion (h, w, 2) px of what each pixel sees at rest, from displacements (ny, nx, 3)."""
        return self._at_seen(self._motion(u_mm)).reshape(self._shape)

    def at_rest(self, u_mm: NDArray[Any]) -> NDArray[Any]:
        """Displacements (ny, nx, 2) at what each pixel sees at rest, (h, w, 2)."""
        return self._at_seen(self._motion.displaced(u_mm)).reshape(self._shape)
