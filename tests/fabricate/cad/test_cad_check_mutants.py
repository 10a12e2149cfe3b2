"""One fault in one part at a time: each turns its own rows of the table to FAIL, and no other."""

from __future__ import annotations

from dataclasses import fields

import pytest
from solids import box, mutated, rod

from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.check import SOLID_CHECKS, check_solids
from deltact_fab.fabricate.cad.check.built import BuiltDesign
from deltact_fab.fabricate.cad.design import (
    IndenterBody,
    IndenterDimensions,
    IndenterList,
    ListedIndenter,
)
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.kernel import require
from deltact_fab.fabricate.cad.parts import indenter
from deltact_fab.fabricate.cad.parts.mold import centres_mm
from deltact_fab.sensor.shapes.indenter import parse_indenter

pytestmark = pytest.mark.slow

D = Design()
LIST = IndenterList(indenter=(ListedIndenter("sphere:10"), ListedIndenter("star")))
BALL = "indenter-sphere-10"
BENCH = ("bench clear", f"bench, {BALL}")
CLOSURE = ("mold volume closure", "mold, skin-frame, skin")


class Watched(BuiltDesign):
    """Notes which parts a check looks at."""

    looked_at: set[str]

    def solid(self, name):
        self.looked_at.add(name)
        return super().solid(name)

    def fact(self, what, names, compute, given=None):
        self.looked_at.update(names)
        return super().fact(what, names, compute, given)


class Sound:
    """Every part of the default design with two indenters, and what each check says of them."""

    def __init__(self):
        self.built = BuiltDesign(D, tuple(registry.list_parts(LIST)))
        watched = Watched(**{f.name: getattr(self.built, f.name) for f in fields(self.built)})
        self.rows, self.looked_at = {}, {}
        for check in SOLID_CHECKS:
            watched.looked_at = set()
            self.rows[check] = check_solids(watched, checks=[check])
            self.looked_at[check] = watched.looked_at

    def failing(self, name, solid):
        """What the failing rows of the whole table find, by check and part, with another solid.

        What does not look at it is not run again; drawings have mutants of their own.
        """
        built, rows = mutated(self.built, {name: solid}), []
        for check in SOLID_CHECKS:
            if check == "drawings" or name not in self.looked_at[check]:
                rows += self.rows[check]
            else:
                rows += check_solids(built, checks=[check])
        return {(row.name, row.subject): row.value for row in rows if row.failed}


@pytest.fixture(scope="module")
def sound():
    require()
    return Sound()


def _fused(solid, more):
    return solid.fuse(more).clean().Solids()[0]


def test_without_a_fault_nothing_fails(sound):
    rows = [row for check in SOLID_CHECKS for row in sound.rows[check]]
    found = {(row.name, row.subject): row.value for row in rows}
    assert [row for row in rows if row.failed] == []
    assert len({row.id for row in rows}) == len(rows) > 30
    assert found["envelope", "assembly"] == "39 x 60 x 30 mm"
    assert found["engagement", "screw, skin-frame"] == "4.60 mm (2.9 d)"
    assert found["wall thickness", "shell"].startswith("1.500 mm")


def thinned_wall(shell):
    x = D.frame_outer_mm[0] / 2
    return shell.cut(box((-x - 1, -3, -22), (-x + 0.7, 3, -18)))


def shifted_hole(shell):
    """The hole at +x, +y filled and drilled again 0.3 mm further out in x."""
    (x, y), radius = D.screw_at_mm, D.screw.row.clearance_mm / 2
    filled = _fused(shell, rod(radius + 0.5, D.z_boss_mm, D.z_joint_mm, x, y))
    return filled.cut(rod(radius, D.z_boss_mm - 1, D.z_joint_mm + 1, x + 0.3, y)).Solids()[0]


def forgotten_hole(shell):
    (x, y), row = D.screw_at_mm, D.screw.row
    return _fused(shell, rod(row.clearance_mm / 2, D.z_boss_mm, D.z_joint_mm, x, y))


def undercut(mold):
    """It is filled with silicone, too: 0.6 x 8 x 1 mm."""
    (x, y), base = centres_mm(D)[0], D.mold.base_mm
    edge = x + D.skin.width_mm / 2
    return mold.cut(box((edge - 1, y - 4, base + 3), (edge + 0.6, y + 4, base + 4)))


def short_screw(screw):
    tip = D.z_head_mm + D.screw.length_mm
    return screw.cut(rod(2, tip - 2, tip + 1))


def poking_holder(holder):
    low = D.z_floor_mm
    return _fused(holder, box((12, -3, low - 0.4), (14, 3, low + 1)))


def long_mount(shell):
    end, low, half = D.frame_outer_mm[1] / 2 + D.mount.length_mm, D.z_floor_mm, D.mount.width_mm / 2
    return _fused(shell, box((-half, end - 1, low), (half, end + 0.5, low + D.mount.height_mm)))


def bar_across_the_view(ring):
    joint, bore = D.z_joint_mm, D.light_bore_mm
    return _fused(ring, box((-bore - 1, 1, joint - 2), (bore + 1, 3, joint - 0.4)))


def deep_head_bore(cover):
    x, y = D.screw_at_mm
    return cover.cut(rod(D.screw.row.bore_mm / 2, D.z_back_mm - 1, D.z_head_mm + 0.2, x, y))


def thin_peg_leg(cover):
    (x, y), low = D.peg_at_mm, D.z_floor_mm
    slot = box((x - 2, y - 2, low + 0.5), (x - 0.55, y + 2, low + 1.5))
    thin = slot.intersect(rod(2.5, low, low + 2, x, y)).cut(rod(1.2, low, low + 2, x, y))
    return cover.cut(thin)


def larger_ball(_):
    return indenter.build(IndenterDimensions(parse_indenter("sphere:10.2"), IndenterBody()))


def high_plate(plate):
    return plate.moved(require().Location((0, 0, 0.5)))


def short_bore(holder):
    return holder.fuse(rod(2.0, 15, 22))


def low_skirt(holder):
    return _fused(holder, rod(16.0, -15, 2).cut(rod(14.0, -16, 0), rod(5.0, -1, 3)))


@pytest.mark.parametrize(
    ("part", "fault", "fails"),
    [
        ("shell", thinned_wall, {("wall thickness", "shell"): "0.800 mm at (-1"}),
        # The hole leaves the screw 0.2 mm: 0.3 mm off, the two of them clash.
        ("shell", shifted_hole, {("interference", "screw, shell"): "screw in shell"}),
        ("shell", forgotten_hole, {("interference", "screw, shell"): "screw in shell"}),
        ("testing-shell", shifted_hole, {BENCH: "screw in testing-shell"}),
        ("mold", undercut, {CLOSURE: "14145.431 mm3"}),
        ("screw", short_screw, {("engagement", "screw, skin-frame"): "2.60 mm (1.6 d)"}),
        ("camera-holder", poking_holder, {
            ("interference", "camera-holder, cover"): "camera-holder in cover: 4.800 mm3",
            ("bed contact", "camera-holder"): "12.0 mm2",
        }),
        ("shell", long_mount, {("envelope", "assembly"): "39 x 60.5 x 30 mm"}),
        ("light-holder", bar_across_the_view, {("light cone", "light-holder"): ""}),
        ("cover", deep_head_bore, {("wall thickness", "cover"): "1.300 mm"}),
        ("cover", thin_peg_leg, {("wall thickness", "cover, legs of the pegs"): ""}),
        (BALL, larger_ball, {("indenter height field", "indenters"): ""}),
        ("stage-plate", high_plate, {BENCH: "cover in stage-plate: "}),
        ("tool-holder", short_bore, {BENCH: f"{BALL} in tool-holder: "}),
        ("tool-holder", low_skirt, {BENCH: ""}),
    ],
)  # fmt: skip
def test_fault_fails_only_its_rows(sound, part, fault, fails):
    found = sound.failing(part, fault(sound.built.solid(part)))
    assert {key: found[key][: len(text)] for key, text in fails.items()} == fails
    # A faulty solid of the bench may stand on its supports otherwise, too.
    assert set(found) - set(fails) <= {("ceilings", "tool-holder"), ("bed contact", "tool-holder")}


def test_unbuildable_part_fails_only_its_rows(sound):
    solids = {name: solid for name, solid in sound.built.solids.items() if name != "cover"}
    told = {"cover": "cover: the CAD kernel failed"}
    rows = check_solids(BuiltDesign(D, sound.built.parts, solids, failures=told))
    found = {row.subject: row.value for row in rows if row.failed}
    assert found == {"sensor": "1/10 invalid: cover: the CAD kernel failed"}
    (undone,) = (row.value for row in rows if row.status == "not run")
    assert undone.endswith(" skipped: cover could not be built")
    assert "mold volume closure" in {row.name for row in rows if not row.failed}


def test_press_deeper_than_tips_is_refused(sound):
    deep = Design(plate=type(D.plate)(depth_mm=11.5))
    built = BuiltDesign(deep, sound.built.parts, sound.built.solids)
    stack = [check for check in SOLID_CHECKS if check == "bench-clear"]
    reach = next(row for row in check_solids(built, checks=stack) if row.name == "bench reach")
    assert reach.failed
    assert "plate.depth_mm" in reach.limit
