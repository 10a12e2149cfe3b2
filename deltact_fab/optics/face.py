"""What a tracked view shows of the face while it moves: the truth that an estimate is held against.

Where frames were drawn through another lens than the view was rectified by, what a pixel shows is
what the true lens sees there.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .camera import CameraModel, axes_mm
from .fisheye import Fisheye
from .lattice import FaceMotion, LatticeSampler, PointSampler, SurfaceLattice
from .rectified import Rectified


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
