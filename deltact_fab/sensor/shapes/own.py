"""Custom indenters of a lab: tables `[shape.NAME]` of cad/indenters.toml."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

from deltact_fab.common import InputError, find_file, read_toml, validate

from .bounded import ShapeError
from .indenters import SHAPE_FACTORIES
from .prism import PrismTip
from .rigid import DEFAULT_REACH_MM, Indenter, PlainTip, PosedTip
from .tips import EllipsoidTip, RidgeTip, SphereTip, require_positive
from .turned import TurnedTip

MIN_SHANK_MM = 3.0  # by hand: length above the equator, for bulging gel
MAX_OFFSET_MM = 30.0  # by hand: diameter of the largest named sphere
TIP_DIMENSIONS = {
    "ball": ("radius_mm",),
    "ridge": ("radius_mm", "half_width_mm", "length_mm", "flank_deg"),
    "ellipsoid": ("a_mm", "b_mm"),
    "polygon": ("points", "outer_mm", "edge_mm"),
    "cylinder": ("radius_mm", "edge_mm"),
}
"""Dimensions of each kind of tip, all required."""


@dataclass(frozen=True)
class OwnTip:
    """One tip: kind, dimensions, position and orientation."""

    kind: Literal["ball", "ridge", "ellipsoid", "polygon", "cylinder"]
    """ball: half a sphere. ridge: a wedge along y with a round nose. ellipsoid: half a spheroid,
    long along x. polygon: a flat face with equal corners. cylinder: vertical, with a flat end."""
    x_mm: float = 0.0
    """Position along x."""
    y_mm: float = 0.0
    """Position along y."""
    turn_deg: float = 0.0
    """Rotation about z, counter-clockwise seen from the back plate; at 0 a ridge is along y."""
    tilt_x_deg: float = 0.0
    """Tilt about x, before the rotation; within 45 degrees."""
    tilt_y_deg: float = 0.0
    """Tilt about y, after that about x and before the rotation; within 45 degrees."""
    radius_mm: float | None = None
    """Radius of a ball, a cylinder, or a ridge's nose."""
    half_width_mm: float | None = None
    """Half width of a ridge at the end of its flanks."""
    length_mm: float | None = None
    """Length of a ridge between the centres of its round ends."""
    flank_deg: float | None = None
    """Angle of a ridge's flanks from the vertical."""
    a_mm: float | None = None
    """Semi-axis of an ellipsoid along x."""
    b_mm: float | None = None
    """Semi-axes of an ellipsoid along y and z."""
    points: int | None = None
    """Number of corners of a polygon, the first on +x."""
    outer_mm: float | None = None
    """Radius of a polygon from its centre to a corner."""
    edge_mm: float | None = None
    """Edge radius of a flat face."""

    __pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # noqa: RUF012

    def tip(self, top_mm: float) -> PlainTip | PosedTip:
        """Build the tip below a back plate. Raises ShapeError for missing or extra dimensions."""
        dimensions = {key for keys in TIP_DIMENSIONS.values() for key in keys}
        values = {key: getattr(self, key) for key in dimensions if getattr(self, key) is not None}
        if set(values) != set(TIP_DIMENSIONS[self.kind]):
            takes = ", ".join(TIP_DIMENSIONS[self.kind])
            has = ", ".join(sorted(values)) or "nothing"
            raise ShapeError(f"a {self.kind} takes {takes}: {has} fails")
        require_positive(self, *values)
        if not max(abs(self.x_mm), abs(self.y_mm)) <= MAX_OFFSET_MM:
            offset = f"{self.x_mm:g}, {self.y_mm:g}"
            raise ShapeError(f"|x_mm|, |y_mm| <= {MAX_OFFSET_MM:g}: {offset} fails")
        turn, tilt = self.turn_deg, (self.tilt_x_deg, self.tilt_y_deg)
        posed = turn != 0 or any(tilt)
        position = (0.0, 0.0) if posed else (self.x_mm, self.y_mm)
        tip = self._upright_tip(values, position)
        return PosedTip(tip, self.x_mm, self.y_mm, turn, *tilt, top_mm) if posed else tip

    def _upright_tip(self, values: dict[str, Any], position: tuple[float, float]) -> PlainTip:
        if self.kind == "polygon":
            tip: PlainTip = PrismTip.polygon(
                values["points"], values["outer_mm"], edge_mm=values["edge_mm"]
            )
        elif self.kind == "cylinder":
            tip = TurnedTip.cylinder(**values)
        else:
            kinds = {"ball": SphereTip, "ridge": RidgeTip, "ellipsoid": EllipsoidTip}
            return kinds[self.kind](*position, **values)
        return replace(tip, x_mm=position[0], y_mm=position[1])


@dataclass(frozen=True)
class OwnShape:
    """Indenter: tips on one back plate, all with their lowest point at the same height."""

    tips: tuple[OwnTip, ...]
    """One table per tip."""
    reach_mm: float = DEFAULT_REACH_MM
    """Free length of tips and shanks, up to the back plate."""

    __pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # noqa: RUF012

    def indenter(self, name: str) -> Indenter:
        """Build the indenter. Raises InputError for an invalid shape."""
        return _build_indenter(name, self)


@lru_cache(maxsize=64)
def _build_indenter(name: str, shape: OwnShape) -> Indenter:
    try:
        if not re.fullmatch(r"[a-z][a-z0-9-]*", name) or name in ("sphere", *SHAPE_FACTORIES):
            raise ShapeError(f"a name of a-z, 0-9 and -, and not a built-in one: {name!r} fails")
        if not shape.tips:
            raise ShapeError("tips >= 1: 0 fails")
        indenter = Indenter(
            name, tuple(tip.tip(shape.reach_mm) for tip in shape.tips), reach_mm=shape.reach_mm
        )
        high = indenter.equator_mm + MIN_SHANK_MM
        if not high <= shape.reach_mm <= 50:
            raise ShapeError(
                f"equator + {MIN_SHANK_MM:g} <= reach_mm <= 50: {high:g}, {shape.reach_mm:g} fails"
            )
    except ShapeError as error:
        raise InputError(f"shape.{name}: {error}") from error
    return indenter


@dataclass(frozen=True)
class _Shapes:
    shape: dict[str, OwnShape]


def own_shapes() -> dict[str, OwnShape]:
    """The shapes of the lab's list, by name. Raises InputError naming file and key."""
    path = find_file("cad", "indenters")
    tables = read_toml(path).get("shape", {})
    return validate(_Shapes, {"shape": tables}, str(path)).shape
