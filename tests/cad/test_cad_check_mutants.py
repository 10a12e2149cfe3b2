"""One fault in one part at a time: each turns its own rows of the table to FAIL, and no other."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, fields

import pytest
from mutated import mutated

from deltact_fab.cad import registry
from deltact_fab.cad.check import soundness
from deltact_fab.cad.check.built import BuiltDesign
from deltact_fab.cad.check.row import Row
from deltact_fab.cad.check.run import CHECKS, of_built
from deltact_fab.cad.design import (
    IndenterBody,
    IndenterDimensions,
    IndenterList,
    ListedIndenter,
    load_design,
)
from deltact_fab.cad.kernel import require
from deltact_fab.cad.parts import cover, indenter, skin_frame
from deltact_fab.cad.parts.mold import centres_mm
from deltact_fab.shapes.indenter import parse

DESIGN = load_design()
LIST = IndenterList(indenter=(ListedIndenter("sphere:10"), ListedIndenter("star")))
SCREWS = "cover, shell, skin-frame"
BENCH = ("bench clear", "bench, indenter-sphere-10")


@pytest.fixture(scope="module")
def cq():
    return require()


class Watched(BuiltDesign):
    """Notes which parts a check looks at."""

    looked_at: set[str]

    def solid(self, name):
        self.looked_at.add(name)
        return super().solid(name)

    def mesh(self, name):
        self.looked_at.add(name)
        return super().mesh(name)

    def fact(self, what, names, compute, given=None):
        self.looked_at.update(names)
        return super().fact(what, names, compute, given)


@dataclass
class Sound:
    """A design without a fault: its solids, and the rows and parts of each check."""

    built: BuiltDesign
    rows: dict[str, list[Row]]
    looked_at: dict[str, set[str]]

    def solid(self, name):
        return self.built.solid(name)

    def box(self, name):
        return self.built.box(name)

    def failing(self, **solids):
        """Check and part of every failing row of the whole table with other solids in it.

        What looks at none of them is not run again.
        """
        mutants = {name.replace("_", "-"): solid for name, solid in solids.items()}
        built, rows = mutated(self.built, mutants), []
        for check in CHECKS:
            # Drawings have mutants of their own (test_cad_scheme).
            if check.name == "drawings" or self.looked_at[check.name].isdisjoint(mutants):
                rows += self.rows[check.name]
            else:
                rows += of_built(built, checks=[check])
        return {(row.check, row.part): row.found for row in rows if not row.passed}


@pytest.fixture(scope="module")
def sound(cq):
    """Every part of the default design, with two indenters."""
    built = BuiltDesign(DESIGN, tuple(registry.listed(LIST)))
    watched = Watched(**{f.name: getattr(built, f.name) for f in fields(built)})
    rows, looked_at = {}, {}
    for check in CHECKS:
        watched.looked_at = set()
        rows[check.name] = of_built(watched, checks=[check])
        looked_at[check.name] = watched.looked_at
    return Sound(built, rows, looked_at)


def _box(cq, low, high):
    size = [b - a for a, b in zip(low, high, strict=True)]
    return cq.Solid.makeBox(*size, cq.Vector(*low))


def _rod(cq, radius, low_z, high_z, x=0.0, y=0.0):
    return cq.Solid.makeCylinder(radius, high_z - low_z, cq.Vector(x, y, low_z), cq.Vector(0, 0, 1))


@pytest.mark.slow
def test_without_a_fault_nothing_fails(sound):
    rows = [row for check in CHECKS for row in sound.rows[check.name]]
    assert {(row.check, row.part): row.found for row in rows if not row.passed} == {}
    found = {(row.check, row.part): row.found for row in rows}
    assert found["envelope", "assembly"] == "39 x 60 x 30 mm"
    assert found["engagement", "screw, skin-frame"] == "4.60 mm (2.9 d)"
    assert found["wall thickness", "shell"].startswith("1.500 mm")


@pytest.mark.slow
def test_a_wall_thinned_by_a_cut(sound, cq):
    x = DESIGN.frame_outer_mm[0] / 2
    cut = _box(cq, (-x - 1, -3, -22), (-x + 0.7, 3, -18))
    found = sound.failing(shell=sound.solid("shell").cut(cut))
    assert list(found) == [("wall thickness", "shell")]
    thin, _, place = found["wall thickness", "shell"].partition(" mm at ")
    assert float(thin) == pytest.approx(0.8)
    x_found, y_found, z_found = map(float, place.strip("()").split(","))
    assert -19.5 < x_found < -17.9
    assert abs(y_found) <= 3
    assert -22 <= z_found <= -18


def _shifted(cq, solid, low_z, high_z):
    """The hole at +x, +y filled and drilled again 0.3 mm further out in x."""
    (x, y), radius = DESIGN.screw_at_mm, DESIGN.screw.row.clearance_mm / 2
    filled = solid.fuse(_rod(cq, radius + 0.5, low_z, high_z, x, y)).clean()
    return filled.cut(_rod(cq, radius, low_z - 1, high_z + 1, x + 0.3, y)).Solids()[0]


@pytest.mark.slow
def test_a_hole_shifted_by_0_3_mm(sound, cq):
    ends = DESIGN.z_boss_mm, DESIGN.z_joint_mm
    shell = _shifted(cq, sound.solid("shell"), *ends)
    found = sound.failing(shell=shell)
    # The hole leaves the screw 0.1 mm: 0.3 mm off, the two of them clash as well.
    assert set(found) == {("screw axes coaxial", SCREWS), ("interference", "screw, shell")}
    assert found["screw axes coaxial", SCREWS] == "0.300 mm, shell at (16.23, 16.73)"
    bench = _shifted(cq, sound.solid("testing-shell"), *ends)
    assert list(sound.failing(testing_shell=bench)) == [
        ("screw axes coaxial", "testing-shell, transparent-base"),
        BENCH,
    ]


@pytest.mark.slow
def test_a_hole_that_was_forgotten(sound, cq):
    (x, y), row = DESIGN.screw_at_mm, DESIGN.screw.row
    plug = _rod(cq, row.clearance_mm / 2, DESIGN.z_boss_mm, DESIGN.z_joint_mm, x, y)
    shell = sound.solid("shell").fuse(plug).clean().Solids()[0]
    found = sound.failing(shell=shell)
    assert found["screw axes coaxial", SCREWS] == "shell has none at (16.23, 16.73)"
    assert set(found) == {("screw axes coaxial", SCREWS), ("interference", "screw, shell")}


@pytest.mark.slow
def test_an_undercut_milled_into_the_mold(sound, cq):
    (x, y), mold, skin = centres_mm(DESIGN)[0], DESIGN.mold, DESIGN.skin
    edge = x + skin.width_mm / 2
    base = mold.base_mm
    slot = _box(cq, (edge - 1, y - 4, base + 3), (edge + 0.6, y + 4, base + 4))
    found = sound.failing(mold=sound.solid("mold").cut(slot))
    # It is filled with silicone, too: 0.6 x 8 x 1 mm.
    assert set(found) == {
        ("no undercut", "mold"),
        ("mold volume closure", "mold, skin-frame, skin"),
    }
    assert found["no undercut", "mold"].startswith("4.8 mm2 look down, ")
    assert ", 0 of " not in found["no undercut", "mold"]
    assert "14145.431 mm3" in found["mold volume closure", "mold, skin-frame, skin"]
    # In a seat, where no silicone comes, it holds the frame and nothing else.
    side = x + DESIGN.frame_outer_mm[0] / 2
    seat = base + skin.protrusion_mm
    groove = _box(cq, (side - 1, y - 4, seat + 0.3), (side + 0.6, y + 4, seat + 1.2))
    assert list(sound.failing(mold=sound.solid("mold").cut(groove))) == [("no undercut", "mold")]


@pytest.mark.slow
def test_a_screw_too_short(sound, cq):
    screw, tip = sound.solid("screw"), DESIGN.z_head_mm + DESIGN.screw.length_mm
    short = screw.cut(_rod(cq, 2, tip - 2, tip + 1))
    found = sound.failing(screw=short)
    assert found == {("engagement", "screw, skin-frame"): "2.60 mm (1.6 d)"}


def test_two_solids_and_none(sound, cq):
    wells = sound.solid("coupon-mold")
    high = sound.box("coupon-mold")[1]
    loose = _box(cq, (high[0] + 1, 0, 0), (high[0] + 6, 5, 5))
    both = cq.Compound.makeCompound([wells, loose])
    assert sound.failing(coupon_mold=both) == {
        ("one valid closed solid", "tools"): "1 of 4 not: coupon-mold: 2 solids, expected one"
    }
    found = sound.failing(coupon_mold=wells.Faces()[0])
    assert found["one valid closed solid", "tools"] == (
        "1 of 4 not: coupon-mold: 0 solids, expected one"
    )


@pytest.mark.slow
def test_a_part_that_pokes_into_another(sound, cq):
    low = DESIGN.z_floor_mm
    peak = _box(cq, (12, -3, low - 0.4), (14, 3, low + 1))
    holder = sound.solid("camera-holder").fuse(peak).clean().Solids()[0]
    found = sound.failing(camera_holder=holder)
    assert found == {
        ("interference", "camera-holder, cover"): "camera-holder in cover: 4.800 mm3",
        ("bed contact", "camera-holder"): "12.0 mm2",
    }


@pytest.mark.slow
def test_an_oversized_part(sound, cq):
    end = DESIGN.frame_outer_mm[1] / 2 + DESIGN.mount.length_mm
    low, half = DESIGN.z_floor_mm, DESIGN.mount.width_mm / 2
    more = _box(cq, (-half, end - 1, low), (half, end + 0.5, low + DESIGN.mount.height_mm))
    shell = sound.solid("shell").fuse(more).clean().Solids()[0]
    found = sound.failing(shell=shell)
    assert found == {("envelope", "assembly"): "39 x 60.5 x 30 mm"}


@pytest.mark.slow
def test_a_bar_across_the_view(sound, cq):
    joint, bore = DESIGN.z_joint_mm, DESIGN.light_bore_mm
    bar = _box(cq, (-bore - 1, 1, joint - 2), (bore + 1, 3, joint - 0.4))
    ring = sound.solid("light-holder").fuse(bar).clean().Solids()[0]
    found = sound.failing(light_holder=ring)
    assert list(found) == [("light cone", "light-holder")]


@pytest.mark.slow
def test_a_bore_for_the_heads_that_is_too_deep(sound, cq):
    (x, y), row = DESIGN.screw_at_mm, DESIGN.screw.row
    deeper = _rod(cq, row.bore_mm / 2, DESIGN.z_back_mm - 1, DESIGN.z_head_mm + 0.2, x, y)
    found = sound.failing(cover=sound.solid("cover").cut(deeper))
    assert set(found) == {("wall thickness", "cover")}
    assert found["wall thickness", "cover"].startswith("1.300 mm")


@pytest.mark.slow
def test_the_legs_of_a_peg_thinned(sound, cq):
    x, y = DESIGN.peg_at_mm
    low = DESIGN.z_floor_mm
    slot = _box(cq, (x - 2, y - 2, low + 0.5), (x - 0.55, y + 2, low + 1.5))
    thin = slot.intersect(_rod(cq, 2.5, low, low + 2, x, y)).cut(_rod(cq, 1.2, low, low + 2, x, y))
    cover = sound.solid("cover").cut(thin)
    found = sound.failing(cover=cover)
    assert list(found) == [("wall thickness", "cover, legs of the pegs")]


@pytest.mark.slow
def test_an_indenter_of_another_stem_or_another_size(sound, cq):
    top = sound.box("indenter-sphere-10")[1][2]
    thick = sound.solid("indenter-sphere-10").fuse(_rod(cq, 3.2, top - 15, top)).clean().Solids()[0]
    found = sound.failing(indenter_sphere_10=thick)
    assert found["indenter stem", "indenters"] == "6.400 mm: indenter-sphere-10"
    assert set(found) - {BENCH} == {("indenter stem", "indenters")}
    other = indenter.build(IndenterDimensions(parse("sphere:10.2"), IndenterBody()))
    found = sound.failing(indenter_sphere_10=other)
    assert list(found) == [("indenter height field", "indenters")]


@pytest.mark.slow
def test_a_part_that_cannot_be_built_fails_its_rows_and_stops_nothing(sound):
    solids = {name: solid for name, solid in sound.built.solids.items() if name != "cover"}
    told = {"cover": "cover: the CAD kernel failed"}
    built = BuiltDesign(DESIGN, sound.built.parts, solids, failed=told)
    rows = of_built(built)
    found = {row.part: row.found for row in rows if row.verdict == "FAIL"}
    assert found == {"sensor": "1 of 10 not: cover: the CAD kernel failed"}
    (undone,) = (row.found for row in rows if row.verdict == "not run")
    assert undone.endswith(" were not run: cover could not be built")
    passed = {row.check for row in rows if row.passed}
    assert {"no undercut", "mold volume closure"} <= passed


def test_what_the_gate_refuses_becomes_a_row(sound, monkeypatch):
    """A builder that returns something else than its closed form: the gate's line, in the table."""
    wrong = dataclasses.replace(cover.PARTS[0], build=skin_frame.build)
    monkeypatch.setattr(cover, "PARTS", (wrong,))
    given = {name: solid for name, solid in sound.built.solids.items() if name != "cover"}
    built = BuiltDesign(DESIGN, tuple(registry.listed(LIST)), given)
    found = {row.part: row.found for row in soundness.rows(built)}
    assert list(built.failed) == ["cover"]
    assert found["sensor"].startswith("1 of 10 not: cover: bounding box ")


@pytest.mark.slow
def test_the_bench_put_together_is_held_apart(cq, sound):
    """A plate that reaches into the sensor, a bore that is too short, a holder that hangs low."""
    high = sound.solid("stage-plate").moved(cq.Location((0, 0, 0.5)))
    assert "cover in stage-plate: " in sound.failing(stage_plate=high)[BENCH]
    plug = _rod(cq, 2.0, 15, 22)
    short = sound.failing(tool_holder=sound.solid("tool-holder").fuse(plug))
    assert short[BENCH].startswith("indenter-sphere-10 in tool-holder: ")
    skirt = _rod(cq, 16.0, -15, 0).cut(_rod(cq, 14.0, -16, 1))
    low = sound.failing(tool_holder=sound.solid("tool-holder").fuse(skirt))
    assert "skin in tool-holder: " in low[BENCH]


@pytest.mark.slow
def test_a_press_as_deep_as_the_tips_are_long_is_refused():
    stack = [check for check in CHECKS if check.name == "bench clear"]
    deep = load_design(changes=["plate.depth_mm=11.5"])
    built = BuiltDesign(deep, tuple(registry.listed(LIST)))
    reach = next(row for row in of_built(built, checks=stack) if row.check == "bench reach")
    assert not reach.passed
    assert "plate.depth_mm" in reach.limit
