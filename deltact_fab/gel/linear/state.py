"""What a solved position of the indenter on a linear face is."""

from __future__ import annotations

from dataclasses import dataclass

from ...aliases import Field, Point


@dataclass(frozen=True, eq=False)
class ContactState:
    """One solved position of the indenter; also the whole history that the next one needs.

    tip_mm: (x, y, depth) of the indenter's lowest point, depth positive into the gel.
    pressure_mpa: (ny, nx). shear_mpa: (ny, nx, 2), on the sensor.
    displacement_mm: (ny, nx, 3) of the face, z out of the sensor, so pressed is negative.
    drag_mpa (ny, nx, 2): what the indenter's sideways travel added to the shear; drag_mm
    (ny, nx, 2): displacement by it, see `contact`. Both 0 in a straight press.
    force_n, torque_nmm: on the sensor, about the centre of the resting face; the torque takes each
    traction where it acts, on the displaced face.
    contact_nodes: how many are under pressure.
    residual: worst violation of the contact conditions, as a length over the depth.
    iterations: operator applications over both problems.
    beyond_small_strain: depth over 10 % of the thickness.
    least_det: smallest det(I + grad u_xy) on the face, below 1 where it is squeezed.
    """

    tip_mm: Point
    pressure_mpa: Field
    shear_mpa: Field
    displacement_mm: Field
    drag_mpa: Field
    drag_mm: Field
    force_n: Point
    torque_nmm: Point
    contact_nodes: int
    residual: float
    iterations: int
    beyond_small_strain: bool
    least_det: float

    def __post_init__(self) -> None:
        # A state is handed on as history; a caller that wrote into it would rewrite the past.
        fields = (self.displacement_mm, self.drag_mm)
        for array in (self.pressure_mpa, self.shear_mpa, self.drag_mpa, *fields):
            array.setflags(write=False)
