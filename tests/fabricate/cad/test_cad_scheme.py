"""What a drawing says is read off the solid: what moves by 0.5 mm changes it or fails its row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.drafting.dimensioning import Callouts, x_of, z_of
from deltact_fab.fabricate.cad.drafting.scheme import Scheme, scheme
from deltact_fab.fabricate.cad.features import features_of
from deltact_fab.fabricate.cad.kernel import require

DESIGNS = ("deltact", "large-60x50")  # the others in cad check
DRAWN = [part.name for part in registry.list_parts() if part.callouts is not None]
MOVE_MM, LESS_MM = 0.5, 0.4
QUICK = ("tool-holder", "nano17-adapter", "acrylic", "coupon-mold")


@pytest.fixture(scope="module")
def cq():
    return require()


def planned(part, design, solid) -> Scheme:
    return scheme(features_of(solid), part.callouts(part.source(design)))


def printed(plan: Scheme) -> list[str]:
    """All texts of a drawing, to hundredths as they are printed, and its faults."""
    lengths = [
        f"{t.axis} {t.prefix}{t.value_mm:.2f}{t.suffix} {t.fitted} {t.auxiliary}"
        for t in plan.lengths
    ]
    return sorted([*lengths, *(g.label for g in plan.rounds), *(w for _, w in plan.other_faces),
                   *plan.faults])  # fmt: skip


def mutants(cq, solid):
    """(what moved, the solid with it moved by MOVE_MM): each hole along x or y, each flat face."""
    found = features_of(solid)
    for r in found.rounds:
        if not (r.hole and r.full_turn):
            continue
        way = [0.0, 0.0, 0.0]
        way[r.axis] = 1.0
        at = cq.Vector(*r.low_mm)
        plug = cq.Solid.makeCylinder(r.radius_mm, r.length_mm, at, cq.Vector(*way))
        for axis in {0, 1, 2} - {r.axis}:
            step = [MOVE_MM * (i == axis) for i in range(3)]
            moved = solid.fuse(plug).cut(plug.translate(cq.Vector(*step)))
            yield f"hole at {r.low_mm} along {axis}", moved.clean()
    for face in solid.Faces():
        normal = face.normalAt()
        if face.geomType() == "PLANE" and max(map(abs, normal.toTuple())) > 1 - 1e-9:
            level = {round(v.toTuple() @ np.array(normal.toTuple()), 6) for v in solid.Vertices()}
            at = round(face.Center().toTuple() @ np.array(normal.toTuple()), 6)
            # A step that is gone has no length.
            move_mm = LESS_MM if round(at + MOVE_MM, 6) in level else MOVE_MM
            slab = cq.Solid.extrudeLinear(face.outerWire(), face.innerWires(), normal * move_mm)
            try:
                moved = solid.fuse(slab).clean()
            except ValueError:  # the kernel gives nothing where the slab touches its neighbours
                continue
            yield f"face at {face.Center().toTuple()}", moved


@pytest.mark.parametrize(
    "name",
    [*QUICK, *(pytest.param(n, marks=pytest.mark.evidence) for n in DRAWN if n not in QUICK)],
)
def test_moved_feature_changes_the_drawing(cq, name):
    part, design = registry.find_part(name), load_design()
    solid, _ = build_part(part, design)
    said = printed(planned(part, design, solid))
    unseen = [
        what
        for what, other in mutants(cq, solid)
        if len(other.Solids()) == 1 and printed(planned(part, design, other)) == said
    ]
    assert unseen == []


@pytest.mark.evidence  # of the shipped designs; the slow tests of the checks have the rows
@pytest.mark.parametrize("design", DESIGNS)
def test_drawings_dimension_every_feature(design):
    dims = load_design(design)
    faults = {}
    for name in DRAWN:
        part = registry.find_part(name)
        if found := planned(part, dims, build_part(part, dims)[0]).faults:
            faults[name] = found
    assert faults == {}


@pytest.mark.parametrize(
    ("lengths", "fault"),
    [
        ((x_of(-10.0, 9.0),), "19 along x ends at 9, where the part has no feature"),
        ((x_of(-10.0, 10.0), x_of(-10.0, 10.0)), "20 along x is redundant"),
        ((z_of(0.0, 2.0), z_of(2.0, 5.0), z_of(0.0, 5.0)), "5 along z is redundant"),
    ],
)
def test_dangling_and_redundant_lengths_are_faults(cq, lengths, fault):
    steps = cq.Workplane().rect(20, 20).extrude(2).union(cq.Workplane().rect(8, 8).extrude(5))
    plan = scheme(features_of(steps.val()), Callouts(lengths))
    assert any(told.startswith(fault) for told in plan.faults)


def test_holes_on_circle_give_angle(cq):
    disc = cq.Workplane().circle(20).extrude(4).faces(">Z").workplane()
    disc = disc.polarArray(12, 15, 360, 5).hole(3).val()
    plan = scheme(features_of(disc), Callouts())
    assert "5× Ø3 through, on Ø24, 72° apart, first at 15°" in [g.label for g in plan.rounds]
    assert {t.axis for t in plan.lengths} == {2}


def test_unknown_face_form_fails(cq):
    lens = cq.Workplane("XZ").moveTo(0, 0).lineTo(8, 0).spline([(4, 5), (0, 6)]).close()
    plan = scheme(features_of(lens.revolve(360, (0, 0), (0, 1)).val()), Callouts())
    assert any(told.startswith("no dimension for the curve") for told in plan.faults)


def test_row_names_part_and_fault():
    from deltact_fab.fabricate.cad.check.built import BuiltDesign
    from deltact_fab.fabricate.cad.check.each_part import drawings

    plate = registry.find_part("acrylic")
    wrong = replace(plate, callouts=lambda _: Callouts((x_of(0.0, 1.0),)))
    (row,) = drawings(BuiltDesign(load_design(), (wrong,)))
    assert row.failed
    assert row.subject == "acrylic"
    assert "1 along x ends at 1, where the part has no feature" in row.value
