"""Turned indenters as solids: cylinder, ring and toy hat against their height field."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from closed_forms import indenter_mm3, segment_mm2

from deltact_fab.aliases import Field
from deltact_fab.cad import registry, solid_gate
from deltact_fab.cad.design import IndenterBody, IndenterDimensions, load_indenters
from deltact_fab.cad.kernel import require
from deltact_fab.cad.mesh import is_closed, mesh_solid
from deltact_fab.cad.parts import indenter as indenter_part
from deltact_fab.shapes import Indenter, SphereTip, TurnedTip
from deltact_fab.shapes.bounded import ShapeError
from deltact_fab.shapes.indenter import parse
from deltact_fab.shapes.turned import ProfilePiece


@pytest.fixture(scope="module")
def cq() -> Any:
    return require()


def underside_mm(solid: Any, x_mm: Field, y_mm: Field) -> Field:
    """Lowest z at which a ray along +z from below meets the solid, inf for a miss."""
    from OCP.gp import gp_Dir, gp_Lin, gp_Pnt
    from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector

    ray = IntCurvesFace_ShapeIntersector()
    ray.Load(solid.wrapped, 1e-9)
    low = np.full(len(x_mm), np.inf)
    for i, (x, y) in enumerate(zip(x_mm.tolist(), y_mm.tolist(), strict=True)):
        ray.Perform(gp_Lin(gp_Pnt(x, y, -10.0), gp_Dir(0, 0, 1)), 0.0, 200.0)
        low[i] = min((ray.Pnt(k).Z() for k in range(1, ray.NbPnt() + 1)), default=np.inf)
    return low


def _moved(tip: TurnedTip, x_mm: float, y_mm: float) -> TurnedTip:
    return TurnedTip(x_mm, y_mm, tip.radius_mm, tip.start_mm, tip.pieces)


def cup() -> TurnedTip:
    """A hole, an arc around it that bulges upwards, one downwards, a flank: no default shape."""
    low, dip = 0.5, 1.5
    middle, sunk = (low + dip) * math.sin(math.pi / 6), low - (low + dip) * math.cos(math.pi / 6)
    start = 0.3, sunk + math.sqrt(dip**2 - 0.3**2)
    joint = dip * math.sin(math.pi / 6), sunk + dip * math.cos(math.pi / 6)
    leave = middle + low * math.sin(math.pi / 4), low - low * math.cos(math.pi / 4)
    pieces = (
        ProfilePiece(joint, (0.0, sunk)),
        ProfilePiece(leave, (middle, low)),
        ProfilePiece((leave[0] + 1.0, leave[1] + 1.0)),
    )
    return TurnedTip(-1.0, 0.5, low, start, pieces)


TWO = Indenter("two", (_moved(TurnedTip.ring(3.0, 0.8), -3.5, 1.0), SphereTip(2.5, -1.0, 2.0)))
PAIR = Indenter("pair", (TurnedTip.ring(4.5, 1.0), SphereTip(0.0, 0.0, 2.0)))
SHAPES = (
    *map(
        parse,
        [f"{kind}{size}" for kind in ("cylinder", "ring", "hat") for size in ("", ":5", ":20")],
    ),
    Indenter("cup", (cup(),)),
    TWO,
    PAIR,
)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_the_solid_s_underside_is_the_height_field(shape: Indenter, cq: Any) -> None:
    dims = IndenterDimensions(shape, IndenterBody())
    solid, made = solid_gate.gate(shape.slug, indenter_part.build(dims), indenter_part.box(dims))
    rng = np.random.default_rng(7)
    hx, hy = indenter_part.plate_half_mm(dims)
    x, y = rng.uniform(-1.05 * hx, 1.05 * hx, 600), rng.uniform(-1.05 * hy, 1.05 * hy, 600)
    field, found = shape.height_mm(x, y), underside_mm(solid, x, y)
    tips = np.isfinite(field)
    assert 50 < tips.sum() < 600
    assert np.abs(found[tips] - field[tips]).max() < 1e-6
    # In a ring's hole, too, nothing stands lower than the plate.
    assert found[~tips].min() > dims.plate_z_mm - 1e-9
    # Boxes that overlap give bounds, everything else one number.
    low, high = indenter_mm3(dims)
    assert (low == high) == (shape is not PAIR)
    assert low * (1 - 1e-6) <= made.volume_mm3 <= high * (1 + 1e-6)


def test_a_ring_s_shank_is_a_tube(cq: Any) -> None:
    dims = IndenterDimensions(parse("ring"), IndenterBody())
    solid = indenter_part.build(dims)
    top = dims.plate_z_mm
    for z, inside in ((0.5 * top, False), (top - 0.01, False), (top + 0.01, True)):
        assert solid.isInside(cq.Vector(0.0, 0.0, z)) is inside
        assert solid.isInside(cq.Vector(3.0, 0.0, z))
    half_mm3 = math.pi**2 * 3.0 * 1.5**2 + math.pi * (4.5**2 - 1.5**2) * (top - 1.5)
    stem_mm2 = math.pi * 9.0 - segment_mm2(2.2, 3.0)
    rest_mm3 = math.pi * 4.5**2 * dims.body.plate_mm + stem_mm2 * 20.0
    assert solid.Volume() == pytest.approx(half_mm3 + rest_mm3, rel=1e-9)


def test_another_height_field_is_noticed(cq: Any) -> None:
    """What the comparison above is worth: a tube a hundredth thinner is far outside it."""
    dims = IndenterDimensions(parse("ring"), IndenterBody())
    solid = indenter_part.build(dims)
    other = Indenter("other", (TurnedTip.ring(4.5, 1.49),))
    d = np.linspace(1.6, 4.4, 50)
    gap = underside_mm(solid, d, np.zeros(50)) - other.height_mm(d, np.zeros(50))
    assert np.abs(gap).max() > 5e-3
    low, high = indenter_mm3(IndenterDimensions(other, IndenterBody()))
    assert not low * (1 - 1e-6) <= solid.Volume() <= high * (1 + 1e-6)


@pytest.mark.parametrize("name", ["cylinder", "ring", "hat"])
def test_the_mesh_is_closed_and_holds_the_volume(name: str, cq: Any) -> None:
    solid = indenter_part.build(IndenterDimensions(parse(name), IndenterBody()))
    volume_mm3 = solid.Volume()
    mesh = mesh_solid(solid, 0.02, name)
    assert is_closed(mesh.triangles)
    assert mesh.deviation_mm <= 0.02
    assert mesh.volume_mm3 == pytest.approx(volume_mm3, rel=5e-3)


def test_the_shipped_list_has_the_paper_s_four_shapes() -> None:
    names = [part.name for part in registry.listed(load_indenters())]
    for name in ("sphere-10", "cylinder", "ring", "hat"):
        assert f"indenter-{name}" in names
    assert registry.find("ring:12").name == "indenter-ring-12"


def test_a_hat_higher_than_its_free_length_is_told_before_the_kernel_runs() -> None:
    tall = Indenter("tall", (TurnedTip.hat(15.0, 8.0, 12.5, 60.0, 0.3),))
    with pytest.raises(ShapeError, match=r"equator_mm < reach_mm: 12\.8 < 12 fails"):
        IndenterDimensions(tall, IndenterBody())
