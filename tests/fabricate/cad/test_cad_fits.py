"""Worst-case play of every pair: by hand, by drawn lots, and on solids at their limits."""

from __future__ import annotations

import dataclasses
import math

import pytest
from click.testing import CliRunner

from deltact_fab.app.cli.main import main
from deltact_fab.fabricate.cad import feasibility
from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.check import ARITHMETIC_CHECKS, arithmetic
from deltact_fab.fabricate.cad.check.row import mark_unverified, shorten_key
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.parts.light_holder import led_room_mm
from deltact_fab.fabricate.cad.registry import design_parts, find_part
from deltact_fab.fabricate.cad.rule import Length, PlayFit

SHIPPED = (
    "deltact", "screws-19mm", "skin-30x34", "skin-44x40", "franka", "fingertip-24x24",
    "large-60x50",
)  # fmt: skip


def every(design: Design) -> dict[str, PlayFit]:
    """Each fit of a design by its name."""
    found = [fit for part in design_parts() for fit in part.fits(design)]
    assert len({fit.name for fit in found}) == len(found)
    return {fit.name: fit for fit in found}


def test_play_and_spread_are_sums():
    hole, shank = Length(2.0, 0.1, ("a",)), Length(1.6, 0.02, ("b",))
    fit = PlayFit("", "", "", (hole, Length(0.5)), (shank, Length(0, 0.3, ("a",))))
    assert fit.range_mm == pytest.approx((0.9 - 0.42, 0.9 + 0.42))
    assert fit.check().basis == ("a", "b")
    assert not fit.check().failed
    assert not dataclasses.replace(fit, least_mm=0.48).check().failed
    assert dataclasses.replace(fit, least_mm=0.481).check().failed
    assert dataclasses.replace(fit, body=(Length(math.nan),)).check().failed
    assert hole.half() == Length(1.0, 0.05, ("a",))


def test_the_default_pairs_by_hand():
    found = every(Design())
    # 36 +- 0.1 less 35.8 +- 0.1
    assert found["plate in its pocket, x"].range_mm == pytest.approx((0.0, 0.4))
    # pocket 2 +- 0.15 and drop 0.5 +- 0.15 less a sheet of 2 +- 10 %
    assert found["plate between the ledges, z"].range_mm == pytest.approx((0.0, 1.0))
    # 2.0 +- 0.1 less 1.6; two pitches of +- 0.1 in x and y, each end half of both: sqrt(2) 0.2
    through = (0.4 - 0.1 - 0.2 * math.sqrt(2), 0.4 + 0.1 + 0.2 * math.sqrt(2))
    assert found["M1.6 through the shell"].range_mm == pytest.approx(through)
    # Ring 1.0 below the joint; shell, pocket, holder, ring +- 0.15, board +- 0.05, sheet +- 0.2
    assert found["ring below the acrylic, z"].range_mm == pytest.approx((0.15, 1.85))
    # 3.2 + 2 x 0.12 less 3.2, +- 0.1 each
    assert found["lips over their hole"].range_mm == pytest.approx((0.04, 0.44))


def test_flat_led_needs_its_sagitta():
    # The back of the strip is a chord of 3.5 mm, whose ends lie on the channel's wall.
    sagitta_mm = 14 - math.sqrt(14**2 - 1.75**2)
    assert led_room_mm(Design()) == pytest.approx(0.8 + 0.3 + sagitta_mm)
    wide = dataclasses.replace(Design(), shell=dataclasses.replace(Design().shell, ledge_mm=17.0))
    assert math.isnan(led_room_mm(wide))


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_designs_pass_rules_and_fits(name):
    design = load_design(name)
    feasibility.check_feasible(design)
    rows = list(mark_unverified([*arithmetic.fits(design), *arithmetic.platform(design)], design))
    assert [row.value for row in rows if row.failed] == []
    every = [row for checks in (*ARITHMETIC_CHECKS, arithmetic.platform) for row in checks(design)]
    for ids in ([row.id for row in every], [rule.id for rule in feasibility.rules(design)]):
        assert len(set(ids)) == len(ids)
    # Nobody has measured these machines, and each row that counts on them says so.
    pocket = next(row for row in rows if row.value.startswith("plate in its pocket"))
    assert {shorten_key(key) for key in pocket.basis} == {"resin printer", "laser"}


def test_a_failing_pair_fails_the_command():
    # An inequality is broken as well, so that no solid is built: the rows are there all the same.
    changes = ["--set", "mold.fit_mm=0.02", "--set", "light.floor_mm=0.5"]
    told = CliRunner().invoke(main, ["cad", "check", *changes])
    assert told.exit_code == 1
    assert "frame in its seat, x: -0.160 to 0.240 mm" in told.output
    assert "3/91 checks failed" in str(told.exception)


def at_limit(design: Design, **sections: dict[str, float]) -> Design:
    """The design with some lengths moved, of which only some parts are then built."""
    moved = {
        name: dataclasses.replace(getattr(design, name), **changes)
        for name, changes in sections.items()
    }
    return dataclasses.replace(design, **moved)


def common_mm3(first, second, at=(0.0, 0.0, 0.0)) -> float:
    from deltact_fab.fabricate.cad.kernel import require

    return float(first.intersect(second.moved(require().Location(at))).Volume())


@pytest.mark.slow
def test_solids_at_limits_do_not_overlap():
    """Plate in the frame's pocket, ring in the shell, frame in the mold: built as they may come."""
    design, off = Design(), Design().resin_printer.plane_mm
    cut = design.laser.tolerance_mm

    def made(name: str, source: Design):
        return build_part(find_part(name), source)[0]

    frame = made("skin-frame", at_limit(
        design, skin={"width_mm": 36 - off, "length_mm": 34 - off},
        frame={"wall_x_mm": 1.5 + off / 2, "wall_y_mm": 3 + off / 2, "seat_y_mm": 1.5},
    ))  # fmt: skip
    plate = at_limit(design, plate={"fit_mm": design.plate.fit_mm - cut / 2})
    # Just inside, just outside: at a limit two faces touch.
    assert common_mm3(frame, made("acrylic", plate)) < 1e-3
    worse = at_limit(design, plate={"fit_mm": design.plate.fit_mm - cut / 2 - 0.02})
    assert common_mm3(frame, made("acrylic", worse)) > 0.1

    shell = made("shell", at_limit(design, shell={"ledge_mm": design.shell.ledge_mm + off / 2}))
    ring = at_limit(design, light={"fit_mm": design.light.fit_mm - off / 2})
    assert common_mm3(shell, made("light-holder", ring)) == 0
    left = (design.ledge_half_mm[1] - off / 2) - ring.light_radius_mm
    assert left > 0
    assert common_mm3(shell, made("light-holder", ring), (0, left - 0.01, 0)) == 0
    assert common_mm3(shell, made("light-holder", ring), (0, left + 0.01, 0)) > 0
