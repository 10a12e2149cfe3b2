"""The paper's figure of the force distribution: flow, normal force, shear, contact in white."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..aliases import Array
from . import figures, maps
from .figures import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..analysis.shape.picture import ShapeMaps

KPA = 1e3  # of an MPa
MIN_KPA = 2.0  # full scale at the least
EXTREME = 98  # percentile that is full scale
DARK = "magma"


@dataclass(frozen=True)
class _Field:
    """Traction (h, w, 3) in kPa at points of the resting face."""

    x_mm: Array
    y_mm: Array
    kpa: Array
    words: str
    true: bool


def has_field(picture: ShapeMaps) -> bool:
    """Whether there is a traction to be drawn."""
    return picture.traction_mpa is not None or picture.true_traction_mpa is not None


def distribution(picture: ShapeMaps, note: str) -> Figure:
    """Found above, and below it what is true, where that is known.

    Of a picture with a traction. Both rows have one scale. Raises ValueError without a traction.
    """
    fields = _fields(picture)
    if not fields:
        raise ValueError(f"{picture.frame_id}: no traction was found, nor is one known")
    figure, axes = figures.blank(9.8, 3.05 * len(fields) + 0.8, 3, share_y=False, rows=len(fields))
    figure.suptitle(f"{note}\n{_forces(picture)}", fontsize="small")
    pressure = max(MIN_KPA, *(_full(-field.kpa[..., 2]) for field in fields))
    shear = max(
        MIN_KPA, *(_full(np.hypot(field.kpa[..., 0], field.kpa[..., 1])) for field in fields)
    )
    for k, field in enumerate(fields):
        beside, normal, across = axes[3 * k : 3 * k + 3]
        last = k == len(fields) - 1
        (_depth if k else _flow)(beside, picture)
        maps.frame(beside, picture, True, last)
        maps.shown(normal, field.x_mm, field.y_mm, -field.kpa[..., 2], DARK, 0, pressure,
                   "pressure, kPa")  # fmt: skip
        normal.set_title(f"normal force, {field.words}", fontsize=maps.HEADS)
        size = np.hypot(field.kpa[..., 0], field.kpa[..., 1])
        maps.shown(across, field.x_mm, field.y_mm, size, DARK, 0, shear, "shear, kPa")
        maps.arrows(across, picture, field.x_mm, field.y_mm, field.kpa[..., :2], None, shear)
        across.set_title(f"shear force, {field.words}", fontsize=maps.HEADS)
        for axis in (normal, across):
            axis.set_facecolor("black")  # where nothing was looked for, nothing presses
            (_true_line if field.true else maps.found_contacts)(axis, picture)
            maps.frame(axis, picture, False, last)
    return figure


def _full(values: Array) -> float:
    """Full scale of what is not 0: single nodes at an edge do not darken the rest."""
    some = values[values > 0.02 * values.max(initial=0)]
    return float(np.percentile(some, EXTREME)) if some.size else 0.0


def _true_line(axis: Axes, picture: ShapeMaps) -> None:
    maps.true_contact(axis, picture, "white", "-")


def _fields(picture: ShapeMaps) -> list[_Field]:
    found = []
    if picture.traction_mpa is not None:
        assert picture.cells_x_mm is not None, "with the traction"
        assert picture.cells_y_mm is not None, "with the traction"
        found.append(_Field(picture.cells_x_mm, picture.cells_y_mm, KPA * picture.traction_mpa,
                            "found", False))  # fmt: skip
    if picture.true_traction_mpa is not None:
        assert picture.face_x_mm is not None, "with the traction"
        assert picture.face_y_mm is not None, "with the traction"
        found.append(_Field(picture.face_x_mm, picture.face_y_mm, KPA * picture.true_traction_mpa,
                            "true", True))  # fmt: skip
    return found


def _flow(axis: Axes, picture: ShapeMaps) -> None:
    most = maps.longest(picture.shift_mm, picture.known)
    maps.photograph(axis, picture)
    maps.arrows(axis, picture, picture.x_mm, picture.y_mm, picture.shift_mm, picture.known, most)
    axis.set_title(f"flow, at most {most:.2f} mm", fontsize=maps.HEADS)


def _depth(axis: Axes, picture: ShapeMaps) -> None:
    top = max(float(picture.depth_mm.max()), maps.MIN_MM)
    maps.shown(axis, picture.x_mm, picture.y_mm, picture.depth_mm, "viridis", 0, top, "depth, mm")
    maps.found_contacts(axis, picture)
    maps.true_contact(axis, picture, COLOURS[1])
    axis.set_title("depth (true contact dashed)", fontsize=maps.HEADS)


def _forces(picture: ShapeMaps) -> str:
    """The two totals, in words."""
    parts = []
    for words, force, torque in (
        ("found", picture.total_n, picture.turning_nmm),
        ("force sensor", picture.force_n, picture.torque_z_nmm),
    ):
        if force is not None:
            x, y, z = (float(v) + 0.0 for v in np.round(force, 2))
            about = "" if torque is None else f", torque about z {round(torque, 1) + 0.0:.1f} N mm"
            parts.append(f"{words}: normal {-z:.2f} N, shear ({x:.2f}, {y:.2f}) N{about}")
    where = f"{picture.indenter} at ({picture.tip_mm[0]:.1f}, {picture.tip_mm[1]:.1f}) mm, "
    return "\n".join([where + f"{picture.tip_depth_mm:.2f} mm deep", *parts])
