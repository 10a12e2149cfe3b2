"""Peak loads of every indenter, position and depth of a protocol."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from ..aliases import Progress, Vector
from ..elasticity.material import GelMaterial
from ..protocols.plan import Protocol, Specimen
from ..shapes import Indenter, SensorDimensions
from ..shapes.indenter import parse as parse_indenter
from .press import Level, PressCurve, press_curve

MODULUS_FACTOR = 2.0
"""The gel's modulus is known to a factor of 2 (Gent's relation from Shore 15A against a
datasheet); forces are in proportion to it, and the high side counts."""
HIGH = "with twice the modulus"
PAPER_REMARK = (
    "the paper's own depth of 10 mm means about 271 N (expected, at 0.56 MPa and friction 0.5) "
    "with a sphere of 15 mm"
)

# Drags of up to 10 mm along x with friction .5, finite strain, 2 mm cells. Tangential peak over
# friction x normal force of the press: at 5 mm sphere:10 1.5 and ellipsoid 1.5 (both up to 7 mm of
# drag), 4dots 2.1, hexprism 1.4; at 10 mm sphere:15 .6 and hexprism 1.3. The gel piles up before a
# narrow tip and pushes on its flank. Normal force over that of the press: at most 1.13.
DRAG_SHEAR = 2.2
DRAG_NORMAL = 1.2
DRAG_FLANK = 0.1  # of the normal force: without friction at all, .07 at 8 mm
LINEAR_SHEAR = 1.05  # at the linear level a full slide gives friction x normal
PRESS_SIDE = 0.1  # of the normal force: a press without shear, a star or near a side
OFF_CENTRE = 0.15  # of the footprint: centre of pressure of a star
GRID = 0.25  # of the thickness: presses in one cell share the curve of its inmost corner


@dataclass(frozen=True)
class Peak:
    """Largest loads while one indenter is at one depth, with the modulus as declared.

    normal_n, tangential_n: magnitudes. moment_nmm: magnitudes about x, y, z at the force sensor's
    origin; None where the rig declares none. level: where the normal force is from; reason: why it
    is no solution, else empty. `high` is MODULUS_FACTOR times all of it.
    """

    indenter: str
    position: int
    at_mm: tuple[float, float]
    depth_mm: float
    normal_n: float
    tangential_n: float
    moment_nmm: Vector | None
    level: Level
    reason: str

    @property
    def high(self) -> Peak:
        """The same with the modulus on the high side."""
        f, m = MODULUS_FACTOR, self.moment_nmm
        moment = None if m is None else (f * m[0], f * m[1], f * m[2])
        return replace(
            self, normal_n=f * self.normal_n, tangential_n=f * self.tangential_n, moment_nmm=moment
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain data, the high side beside the expected one."""
        high = self.high
        return {
            **asdict(self),
            "normal_high_n": high.normal_n,
            "tangential_high_n": high.tangential_n,
            "moment_high_nmm": high.moment_nmm,
        }


def predict(
    protocol: Protocol,
    sensor: SensorDimensions,
    origin_mm: Vector | None = None,
    progress: Progress | None = None,
    solve: bool = True,
) -> list[Peak] | None:
    """Peaks in the order of the plan; solve False: None where that would take more than seconds.

    The normal force is that of `press.press_curve`. Free sides make a gel softer, so a press takes
    the curve of a place up to GRID of the thickness nearer to the centre; mirror images share one.
    Tangential: a drag is bounded by friction x normal force times DRAG_SHEAR, which is never less
    than linear theory gives (at most friction x normal force). Moments are bounds as well: of the
    force anywhere between the resting face and the tip, wherever the drag takes it. A gel with a
    Prony series is taken as pressed at once, before it relaxes.
    Raises InputError for a depth outside of the gel.
    """
    specimen = protocol.specimen
    material = GelMaterial(specimen.modulus_mpa, specimen.poisson, specimen.friction)
    skin = sensor.skin
    curves: dict[tuple[str, tuple[float, float]], PressCurve] = {}
    peaks = []
    for name in protocol.indenters:
        indenter = parse_indenter(name)
        for number, at in enumerate(protocol.positions_mm, start=1):
            place = _inmost(at, GRID * skin.thickness_mm)
            if (name, place) not in curves:
                curve = press_curve(
                    skin, material, indenter, place, protocol.depths_mm, progress, solve
                )
                if curve is None:
                    return None
                curves[name, place] = curve
            curve = curves[name, place]
            for depth in protocol.depths_mm:
                peaks.append(_peak(protocol, indenter, number, at, depth, curve, origin_mm))
    return peaks


def worst(figures: Sequence[float], peaks: Sequence[Peak]) -> tuple[float, str]:
    """The largest of the peaks' figures, and the press that it comes with."""
    k = max(range(len(peaks)), key=lambda k: figures[k])
    peak = peaks[k]
    x, y = peak.at_mm
    why = f" ({peak.level}: {peak.reason})" if peak.reason else ""
    return figures[k], f"{peak.indenter} at ({x:g}, {y:g}) mm, {peak.depth_mm:g} mm deep{why}"


def _inmost(at_mm: tuple[float, float], grid_mm: float) -> tuple[float, float]:
    x, y = (math.floor(abs(v) / grid_mm + 1e-9) * grid_mm for v in at_mm)
    return x, y


def _peak(
    protocol: Protocol, indenter: Indenter, number: int, at_mm: tuple[float, float],
    depth_mm: float, curve: PressCurve, origin_mm: Vector | None,
) -> Peak:  # fmt: skip
    unit_n, level = curve.normal_n(depth_mm)
    normal = unit_n * _sudden_mpa(protocol.specimen)
    friction = protocol.specimen.friction
    side = PRESS_SIDE * normal
    if protocol.shear and level == "linear":
        side = max(side, LINEAR_SHEAR * friction * normal)
    elif protocol.shear:
        side = max(DRAG_SHEAR * friction, DRAG_FLANK) * normal
        normal *= DRAG_NORMAL
    moment = None
    if origin_mm is not None:
        moment = _moment(protocol, indenter, at_mm, depth_mm, normal, side, origin_mm)
    reason = curve.ended if level in ("extrapolated", "bound") else ""
    return Peak(
        indenter.name, number, at_mm, depth_mm, normal, side, moment, level, reason
    )  # fmt: skip


def _sudden_mpa(specimen: Specimen) -> float:
    """The modulus before any relaxation: a Prony series adds its shares to the long-term one."""
    return specimen.modulus_mpa * (1.0 + math.fsum(g for g, _ in specimen.prony))


def _moment(
    protocol: Protocol, indenter: Indenter, at_mm: tuple[float, float], depth_mm: float,
    normal_n: float, side_n: float, origin_mm: Vector,
) -> Vector:  # fmt: skip
    """Bounds of r x F; r runs from the origin to wherever the force may act."""
    shear = protocol.shear
    arms = []
    for axis, letter in enumerate("xy"):
        travel = shear.at_depth_mm(depth_mm) if shear and letter in shear.axes else 0.0
        off = OFF_CENTRE * indenter.footprint_half_mm[axis]
        arms.append(abs(at_mm[axis] - origin_mm[axis]) + travel + off)
    x, y = arms
    z = max(abs(origin_mm[2]), abs(origin_mm[2] + depth_mm))
    return (
        y * normal_n + z * side_n,
        x * normal_n + z * side_n,
        math.hypot(x, y) * side_n,
    )
