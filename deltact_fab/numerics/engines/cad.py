"""The CAD kernel: how far its triangles lie from the surface, and what it answers to nonsense.

A ball is judged by its equation, not by the mesher's own measurement. The raw kernel, asked once,
oversteps the tolerance that it is given; `mesh_solid` measures and asks again.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...cad import feasibility, mesh, solid_gate
from ...cad.build import build_part, expected
from ...cad.design import load_design
from ...cad.dimensions import Design
from ...cad.kernel import guarded, require
from ...cad.registry import find, of_design
from ...cad.solid_gate import Expected, gate
from ...cad.stiffness import PlateShape, bend, plate_of
from ..engine import Case, CurveSetting, Engine, EngineTable, Work

BALL_MM = 22.0
PARTS = of_design()
# The kernel jumps from 0.007 to 20 times as many triangles below 0.01 mm: seconds a call.
PLATE_TERMS_MOST = 24
TOLERANCES_MM = (0.1, 0.05, 0.02, 0.01)
BY_SIZE = ("light.strip_width_mm",)


def distance_to_ball_mm(corners_mm: Any, radius_mm: float) -> float:
    """Largest distance of triangles (m, 3, 3) to a sphere about the origin, 45 points each."""
    n = 8
    weights = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    worst = 0.0
    for block in np.array_split(corners_mm, max(1, len(corners_mm) // 4000)):
        points = np.einsum("sc,mcx->msx", weights, block)
        worst = max(worst, float(np.abs(np.linalg.norm(points, axis=-1) - radius_mm).max()))
    return worst


def _ball(once: bool, tolerance_mm: float, scratch: Path) -> Work:
    solid = require().Solid.makeSphere(BALL_MM / 2, angleDegrees1=-90)
    make: Callable[[], mesh.Mesh] = (
        partial(mesh.mesh_once, solid, tolerance_mm)
        if once
        else partial(mesh.mesh_solid, solid, tolerance_mm, "ball")
    )
    return Work(make, lambda found: distance_to_ball_mm(found.corners_mm, BALL_MM / 2))


def _part(name: str, tolerance_mm: float, scratch: Path) -> Work:
    solid, _ = build_part(find(name), load_design())
    return Work(
        partial(mesh.mesh_solid, solid, tolerance_mm, name), lambda found: found.deviation_mm
    )


def _plate_yields(plate: PlateShape, terms: int, spread_mm: float) -> float:
    """Deflection under 1 N, nothing of it from the store."""
    return bend.__wrapped__(plate, spread_mm, terms=terms).deflection_mm


def _plate(terms: int, scratch: Path) -> Work:
    plate = plate_of(load_design())
    exact = _plate_yields(plate, PLATE_TERMS_MOST, 22.0)
    return Work(partial(_plate_yields, plate, terms, 22.0), lambda found: abs(found / exact - 1))


def _square_plate(side_mm: float, thickness_mm: float, scratch: Path) -> float:
    """A load in the middle of a supported square: w D / (P a^2) over Timoshenko's .01160, - 1."""
    half = (side_mm / 2, side_mm / 2)
    plate = PlateShape(half, (0.0, 0.0), half, thickness_mm, 3000.0, 0.3)
    yields = _plate_yields(plate, PLATE_TERMS_MOST, side_mm / 1000)
    return yields * plate.rigidity_nmm / side_mm**2 / 0.01160 - 1


def _strip(scratch: Path) -> float:
    """A strip of 1 x 200 mm on its ends over the beam's F l^3 / (48 E I), - 1."""
    plate = PlateShape((0.5, 100.0), (0.0, 0.0), (None, 100.0), 1.0, 3000.0, 0.0)
    return _plate_yields(plate, PLATE_TERMS_MOST, 0.5) / (200**3 / (48 * 3000 / 12)) - 1


def curves(quick: bool) -> Sequence[CurveSetting]:
    """Tolerance against measured distance and time."""
    float32_mm = 1e-6
    out = [
        CurveSetting(
            case=f"ball of {BALL_MM:g} mm",
            series=series,
            name=f"tolerance {tolerance:g} mm",
            unit="mm",
            reference="the sphere's equation",
            reference_error=float32_mm,
            build=partial(_ball, once, tolerance),
        )
        for series, once in (("kernel, asked once", True), ("measured and asked again", False))
        for tolerance in ((0.05,) if quick else TOLERANCES_MM)
    ]
    out += [
        CurveSetting(
            case="acrylic plate under 1 N",
            series="polynomials in each direction",
            name=f"{terms} terms",
            unit="of the deflection",
            reference=f"{PLATE_TERMS_MOST} terms",
            reference_error=1e-3,
            build=partial(_plate, terms),
        )
        for terms in ((8,) if quick else (4, 6, 8, 10, 14, 18))
    ]
    if quick:
        return out
    return out + [
        CurveSetting(
            case=f"part: {name}",
            series="measured and asked again",
            name=f"tolerance {tolerance:g} mm",
            unit="mm",
            reference="the exact surfaces, sampled",
            reference_error=float32_mm,
            build=partial(_part, name, tolerance),
        )
        for name, tolerance in (("shell", 0.01), ("star", 0.01), ("star", 0.002))
    ]


def _box(side: float = 10.0) -> Any:
    return require().Workplane().box(side, side, side)


def _wanted(volume_mm3: float, side: float = 10.0) -> Expected:
    h = side / 2
    return Expected((volume_mm3, volume_mm3), ((-h, -h, -h), (h, h, h)), {"side_mm": side})


def _gated(make: Callable[[], Any], volume_mm3: float, scratch: Path) -> float:
    """What a part's builder goes through: guard, then gate."""
    with guarded("trial", {"volume_mm3": volume_mm3}):
        _, found = gate("trial", make().val(), _wanted(volume_mm3))
    return found.volume_mm3 / volume_mm3 - 1


def _filleted(radius_mm: float) -> Any:
    return _box().edges().fillet(radius_mm)


def _nan_box() -> Any:
    return _box(math.nan)


def _drilled(at_mm: float, diameter_mm: float) -> Any:
    return _box().faces(">Z").workplane().center(at_mm, 0).hole(diameter_mm)


def _split() -> Any:
    return _box().cut(require().Workplane().box(2, 12, 12))


def _hollow() -> Any:
    return _box().shell(-25)


def _nothing() -> Any:
    return _box().cut(_box(12))


def _changed(changes: Sequence[str], scratch: Path) -> float:
    """Worst relative error of a volume over all parts with an exact closed form."""
    return worst_volume_error(load_design("deltact", changes))


def worst_volume_error(design: Design) -> float:
    """Over all parts of a design; where a volume is only bounded, the excess over its bounds."""
    feasibility.check(design)
    worst = 0.0
    for part in PARTS:
        low, high = expected(part, design).volume_mm3
        found = build_part(part, design)[1].volume_mm3
        worst = max(worst, (low - found) / low, (found - high) / high)
    return worst


def scaled(factor: float) -> Design:
    """The default design with every length times factor; what is bought by size stays."""
    changes = []
    design = Design()
    for section in dataclasses.fields(design):
        record = getattr(design, section.name)
        for f in dataclasses.fields(record):
            key, value = f"{section.name}.{f.name}", getattr(record, f.name)
            if f.name.endswith("_mm") and isinstance(value, float) and key not in BY_SIZE:
                changes.append(f"{key}={factor * value!r}")
    return load_design("deltact", changes)


def _scaled(factor: float, scratch: Path) -> float:
    return worst_volume_error(scaled(factor))


def _coarse_after_fine(scratch: Path) -> tuple[float, str]:
    """Triangles that a coarse mesh has too many after a fine one of the same solid."""
    solid = require().Solid.makeSphere(BALL_MM / 2, angleDegrees1=-90)
    first = len(mesh.mesh_solid(solid, 0.1, "ball").triangles)
    fine = len(mesh.mesh_solid(solid, 0.005, "ball").triangles)
    again = len(mesh.mesh_solid(solid, 0.1, "ball").triangles)
    return again - first, f"{first} triangles, {fine} in between"


def _over_tolerance(diameter_mm: float, tolerance_mm: float, scratch: Path) -> tuple[float, str]:
    solid = require().Solid.makeSphere(diameter_mm / 2, angleDegrees1=-90)
    made = mesh.mesh_solid(solid, tolerance_mm, "ball")
    found = distance_to_ball_mm(made.corners_mm, diameter_mm / 2)
    return found / tolerance_mm, f"{len(made.triangles)} triangles, {found:.3g} mm"


def _box_after_meshing(scratch: Path) -> float:
    """Growth of the box that the gate reads, once the solid has a mesh (mm)."""
    solid, found = build_part(find("skin"), load_design())
    mesh.mesh_solid(solid, 0.1, "skin")
    return float(np.abs(np.subtract(solid_gate.bounding_box(solid), found.box_mm)).max())


def _same_stl(scratch: Path) -> float:
    """Bytes in which two STL files of one part differ, the second after other work."""
    from ...cad.export.formats.stl import stl_bytes

    def write() -> bytes:
        solid, _ = build_part(find("sphere:10"), load_design())
        return stl_bytes(mesh.mesh_solid(solid, 0.02, "p"), "p")

    first = write()
    build_part(find("shell"), load_design())
    second = write()
    return abs(len(first) - len(second)) + sum(a != b for a, b in zip(first, second, strict=False))


def cases(quick: bool) -> Sequence[Case]:
    """Nonsense that must be refused, ends of the limits, scales, and the mesher's own traps."""
    relative = "of the volume"
    out = [
        Case("wall 0", "refused", partial(_changed, ["shell.wall_mm=0"]), says="wall_mm"),
        Case("wall NaN", "refused", partial(_changed, ["shell.wall_mm=nan"]), says="wall_mm"),
        Case("fillet as large as the protrusion", "refused",
             partial(_changed, ["skin.edge_fillet_mm=6"]), says="edge_fillet_mm < protrusion_mm"),
        Case("skin of 24 x 24 mm", "refused",
             partial(_changed, ["skin.width_mm=24", "skin.length_mm=24"]), says="corner posts"),
        # The kernel itself: only the gate tells these from a part.
        Case("kernel: hole off the part", "refused",
             partial(_gated, partial(_drilled, 20.0, 2.0), 1000 - 10 * math.pi), says="volume"),
        Case("kernel: cut that splits the part", "refused", partial(_gated, _split, 800.0),
             says="2 solids"),
        Case("kernel: cut that leaves nothing", "refused", partial(_gated, _nothing, 1000.0),
             says="0 solids"),
        Case("kernel: wall thicker than the part", "refused", partial(_gated, _hollow, 999.0),
             says="trial"),
        Case("kernel: NaN", "refused", partial(_gated, _nan_box, 1000.0), says="trial"),
        Case("kernel: fillet at its limit", "refused",
             partial(_gated, partial(_filleted, 5.0), 1000 * math.pi / 6), says="trial"),
        Case("kernel: fillet past its limit", "refused",
             partial(_gated, partial(_filleted, 6.0), 1000.0), says="trial"),
        Case("kernel: fillet of 1e-7", "refused", partial(_gated, partial(_filleted, 1e-7), 1000.0),
             says="trial"),
        Case("coarse mesh after a fine one", "right", _coarse_after_fine, 0, "triangles"),
        Case("box of a meshed solid", "right", _box_after_meshing, 1e-5, "mm"),
        Case("plate: square of 34 x 34 x 2 mm", "right", partial(_square_plate, 34.0, 2.0), 5e-3,
             "of the deflection"),
        Case("plate: 200 x 200 x .5 mm", "right", partial(_square_plate, 200.0, 0.5), 5e-3,
             "of the deflection"),
        Case("plate: strip of 1 x 200 mm", "right", _strip, 1e-2, "of the deflection"),
        Case("ball of 22 mm at 0.05 mm", "right", partial(_over_tolerance, 22.0, 0.05), 1.0,
             "of the tolerance"),
    ]  # fmt: skip
    if quick:
        return out
    near = 6 - 1e-3
    return out + [
        Case("defaults, every part", "right", partial(_changed, []), 1e-6, relative),
        Case("fillet 1 um below the protrusion", "right",
             partial(_changed, [f"skin.edge_fillet_mm={near!r}"]), 1e-6, relative),
        Case("fillet of 0.05 mm", "right", partial(_changed, ["skin.edge_fillet_mm=0.05"]), 1e-6,
             relative),
        *(
            Case(f"every length x {factor:g}", "right or refused", partial(_scaled, factor), 1e-6,
                 relative, "fails")
            for factor in (0.7, 0.9, 1.2, 3.0)
        ),
        Case("ball of 22 mm at 0.002 mm", "right", partial(_over_tolerance, 22.0, 0.002), 1.0,
             "of the tolerance"),
        Case("ball of 0.5 mm at 1 mm", "right", partial(_over_tolerance, 0.5, 1.0), 1.0,
             "of the tolerance"),
        Case("STL written twice", "right", _same_stl, 0, "bytes"),
    ]  # fmt: skip


def tables(scratch: Path) -> Sequence[EngineTable]:
    """Tolerance, what was measured, triangles and seconds, part by part."""
    rows = []
    design = load_design()
    for name in ("sphere:22", "skin", "shell", "cover", "mold"):
        solid, _ = build_part(find(name), design)
        for tolerance in (0.1, 0.01, 0.002):
            start = time.process_time()
            made = mesh.mesh_solid(solid, tolerance, name)
            seconds = time.process_time() - start
            rows.append(
                (name, tolerance, made.deviation_mm, len(made.triangles), round(seconds, 3))
            )
    return (
        EngineTable(
            "Tessellation",
            "Tolerance asked for, distance measured, and what it costs. CPU seconds include the "
            "measurement and every repetition.",
            ("part", "tolerance, mm", "measured, mm", "triangles", "CPU s"),
            tuple(rows),
        ),
    )


ENGINE = Engine(
    "cad",
    "CAD kernel",
    "Triangles against exact surfaces, and nonsense that the kernel answers in silence.",
    curves,
    cases,
    tables,
)
