"""One frame of a press as drawn: the image, the measurement, and the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...aliases import Array
from ...shapes import Indenter
from ...shapes.indenter import of_run


@dataclass(frozen=True)
class ShapeMaps:
    """A frame of a press; maps (h, w) on x_mm (w,), y_mm (h,) of the resting face.

    tip_mm (3,): of the indenter, as the stage says. image (H, W, 3) BGR uint8 over edges_mm: left,
    right, top and bottom, as the camera sees it, row 0 being at -y. shift_mm (h, w, 2), known: the
    flow. relative, reliable: minus the Gaussian density from rest, and where it can be relied on.
    depth_mm: into the gel. outlines_mm: of the contacts found. force_n (3,), torque_z_nmm: the
    sensor's word. shape: of an indenter of the lab's own, as the run kept it.

    By a calibration of force, else None: total_n (3,), turning_nmm (the torque about z) and
    traction_mpa (cy, cx, 3) on cells_x_mm, cells_y_mm. Where there is a truth, else None:
    true_depth_mm, true_contact (h, w), and, where the run kept tractions, true_traction_mpa
    (ny, nx, 3) on face_x_mm, face_y_mm.
    """

    indenter: str
    frame_id: str
    tip_mm: Array
    image: Array
    edges_mm: Array
    x_mm: Array
    y_mm: Array
    shift_mm: Array
    known: Array
    relative: Array
    reliable: Array
    depth_mm: Array
    outlines_mm: list[Array]
    force_n: Array | None = None
    torque_z_nmm: float | None = None
    total_n: Array | None = None
    turning_nmm: float | None = None
    traction_mpa: Array | None = None
    cells_x_mm: Array | None = None
    cells_y_mm: Array | None = None
    true_depth_mm: Array | None = None
    true_contact: Array | None = None
    true_traction_mpa: Array | None = None
    face_x_mm: Array | None = None
    face_y_mm: Array | None = None
    shape: dict[str, Any] | None = None

    @property
    def pressed(self) -> Indenter:
        """The indenter as a shape."""
        return of_run(self.indenter, {self.indenter: self.shape} if self.shape else {}, "a picture")

    @property
    def tip_depth_mm(self) -> float:
        """How deep the tip is, 0 above the face."""
        return max(0.0, -float(self.tip_mm[2]))

    @property
    def cell_mm(self) -> float:
        """Distance of neighbouring points."""
        return float(self.x_mm[1] - self.x_mm[0])

    @property
    def tractions(self) -> list[tuple[str, Array, Array, Array]]:
        """Those that are known: words, x_mm, y_mm and the traction (ny, nx, 3) in MPa."""
        fields = (
            ("found", self.cells_x_mm, self.cells_y_mm, self.traction_mpa),
            ("true", self.face_x_mm, self.face_y_mm, self.true_traction_mpa),
        )
        return [
            (words, x_mm, y_mm, mpa)
            for words, x_mm, y_mm, mpa in fields
            if x_mm is not None and y_mm is not None and mpa is not None
        ]
