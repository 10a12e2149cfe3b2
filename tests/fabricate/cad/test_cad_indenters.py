"""Indenters as solids: every shape's underside against its height field, its volume, its plate."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from closed_forms import indenter_mm3, segment_mm2

from deltact_fab.common.aliases import Field
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad import kernel, registry
from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.design import (
    IndenterBody,
    IndenterDimensions,
    IndenterList,
    load_indenters,
)
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.kernel import require
from deltact_fab.fabricate.cad.parts import indenter as indenter_part
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.prism import PrismTip
from deltact_fab.sensor.shapes.rigid import Indenter
from deltact_fab.sensor.shapes.tips import EllipsoidTip, RidgeTip, SphereTip
from deltact_fab.sensor.shapes.turned import ProfilePiece, TurnedTip


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


UNEVEN = Indenter("uneven", (SphereTip(-3.0, 0.0, 2.0), SphereTip(0.5, 1.0, 3.0)))
PAIR = Indenter("pair", (TurnedTip.ring(4.5, 1.0), SphereTip(0.0, 0.0, 2.0)))
RING = TurnedTip.ring(3.0, 0.8)
# Off the axis, and not of the default proportions.
MIXED = Indenter(
    "mixed",
    (
        RidgeTip(-4.0, 1.0, 0.5, 0.8, 3.0, flank_deg=50.0),
        EllipsoidTip(0.0, -2.5, 2.0, 2.4),
        PrismTip(4.8, 2.0, 3, 2.5, 1.1, 0.4, 0.9, 0.35),
        TurnedTip(-5.5, -4.5, RING.radius_mm, RING.start_mm, RING.pieces),
    ),
)
NAMES = (
    *("sphere:4", "sphere:22", "4dots", "2dots", "edges:5", "ellipsoid", "hexprism", "star:20"),
    *("cylinder:5", "ring:20", "hat"),
)
SHAPES = (*map(parse_indenter, NAMES), Indenter("cup", (cup(),)), UNEVEN, PAIR, MIXED)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_the_underside_is_the_height_field(shape: Indenter) -> None:
    dims = IndenterDimensions(shape, IndenterBody())
    solid, made = kernel.gate(shape.slug, indenter_part.build(dims), indenter_part.box(dims))
    # Boxes that overlap give bounds, everything else one number.
    low, high = indenter_mm3(dims)
    assert (low == high) == (shape not in (UNEVEN, PAIR))
    assert low * (1 - 1e-6) <= made.volume_mm3 <= high * (1 + 1e-6)
    rng = np.random.default_rng(11)
    hx, hy = indenter_part.plate_half_mm(dims)
    x, y = rng.uniform(-1.05 * hx, 1.05 * hx, 400), rng.uniform(-1.05 * hy, 1.05 * hy, 400)
    field, found = shape.height_mm(x, y), underside_mm(solid, x, y)
    tips = np.isfinite(field)
    assert 30 < tips.sum() < 400
    assert np.abs(found[tips] - field[tips]).max() < 1e-6
    # In a ring's hole, too, nothing stands lower than the plate.
    assert found[~tips].min() > dims.indenter.reach_mm - 1e-9
    # The plate covers the tips.
    middle = dims.indenter.reach_mm + dims.body.plate_mm / 2
    over = np.column_stack([x, y])[tips & (abs(x) < hx) & (abs(y) < hy)][:60]
    assert all(solid.isInside(require().Vector(a, b, middle), 1e-6) for a, b in over.tolist())


def test_ring_shank_and_wrong_height_field() -> None:
    dims = IndenterDimensions(parse_indenter("ring"), IndenterBody())
    solid, top = indenter_part.build(dims), dims.indenter.reach_mm
    for z, inside in ((0.5 * top, False), (top - 0.01, False), (top + 0.01, True)):
        assert solid.isInside(require().Vector(0.0, 0.0, z)) is inside
        assert solid.isInside(require().Vector(3.0, 0.0, z))
    half_mm3 = math.pi**2 * 3.0 * 1.5**2 + math.pi * (4.5**2 - 1.5**2) * (top - 1.5)
    stem_mm2 = math.pi * 9.0 - segment_mm2(2.2, 3.0)
    rest_mm3 = math.pi * 4.5**2 * dims.body.plate_mm + stem_mm2 * 20.0
    assert solid.Volume() == pytest.approx(half_mm3 + rest_mm3, rel=1e-9)
    # What the comparison above is worth: a tube a hundredth thinner is far outside it.
    other = Indenter("other", (TurnedTip.ring(4.5, 1.49),))
    d = np.linspace(1.6, 4.4, 50)
    gap = underside_mm(solid, d, np.zeros(50)) - other.height_mm(d, np.zeros(50))
    assert np.abs(gap).max() > 5e-3


def test_listed_indenters_and_any_size() -> None:
    names = [part.name for part in registry.list_parts(load_indenters())]
    assert {f"indenter-{n}" for n in ("sphere-10", "cylinder", "ring", "hat")} <= {*names}
    assert registry.find_part("ring:12").name == "indenter-ring-12"


def test_body_dimensions_reach_the_solid() -> None:
    known = IndenterList(IndenterBody(plate_mm=2.5))
    _, found = build_part(registry.find_part("sphere:10", known), Design())
    assert found.box_mm[1][2] == pytest.approx(12.0 + 2.5 + 20.0)


def test_an_indenter_list_names_its_file(tmp_path: Any) -> None:
    path = tmp_path / "mine.toml"
    for text, says in (
        ('[[indenter]]\nname = "cube:3"\n', "indenter 'cube:3': unknown"),
        ('[[indenter]]\nname = "star"\n' * 2, "'star': listed twice"),
        ("[body]\nshank_mm = 3.0\n", r"body\.shank_mm: unknown key"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=rf"mine\.toml: .*{says}"):
            load_indenters(str(path))
