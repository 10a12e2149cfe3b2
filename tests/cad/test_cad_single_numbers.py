"""Single numbers as a mechanic judges them: a wrong one fails and names its key, a right passes.

The tables were drawn up from drawings and catalogues before it was seen what the checks say of
them. About eleven entries moved afterwards, for the check was right or the number changes nothing.
"""

from __future__ import annotations

import pytest

from deltact_fab.cad.check import Row, fits, inequalities, run
from deltact_fab.cad.check.advice import advice
from deltact_fab.cad.check.row import advised
from deltact_fab.cad.check.run import ARITHMETIC
from deltact_fab.cad.design import IndenterList, ListedIndenter, load_design
from deltact_fab.errors import InputError

# Refused, or arithmetic says so.
WRONG = (
    # walls that the process does not make, holes near an edge or each other
    "light.floor_mm=0.4",
    "holder.wall_mm=0.5",
    "frame.wall_x_mm=0.5",
    "mold.base_mm=0.5",
    "coupon.wall_mm=0.5",
    "tool.flange_diameter_mm=27",
    "tool.body_mm=8",
    "table.tab_mm=5",
    "mount.hole_pitch_mm=18",
    "mount.width_mm=5",
    # what does not go in, through or over
    "light.channel_mm=1.5",
    "light.slot_mm=0.8",
    "light.strip_width_mm=12",
    "light.leds_per_m=30",
    "shell.cable_width_mm=15",
    "shell.cable_height_mm=1.0",
    "holder.clearance_mm=2",
    "holder.fit_mm=0.02",
    "cover.peg_clearance_mm=0.05",
    "cover.lip_mm=0.4",
    "cover.slot_mm=0.2",
    "cover.fit_mm=0.02",
    "plate.fit_mm=0.02",
    "mold.fit_mm=0.02",
    "mold.pry_mm=3.9",
    "tool.fit_mm=0.02",
    "tool.depth_mm=10",
    "tool.pin_fit_mm=0.02",
    "tool.screw_hole_mm=2.9",
    "stage_plate.slot_mm=5",
    "mount.height_mm=20",
    "table.height_mm=3",
    "kerf_coupon.width_mm=50",
    "camera.board_width_mm=30",
    "camera.lens_diameter_mm=24",
    "camera.connector_height_mm=3.2",
    "resin_printer.bed_x_mm=60",
    # screws that do not grip, or stand out
    "screw.length_mm=22",
    "screw.tip_clearance_mm=0.5",
    "holder.screw_length_mm=4",
    "adapter.pilot_mm=3.2",
    "adapter.thickness_mm=4",
    "tool.clamp_mm=3.2",
    "stage_plate.thread_hole_mm=4.2",
    "stage_plate.thread_hole_mm=3.0",
    "stage_plate.thickness_mm=3",
    # machines that do not keep what the fits need
    "resin_printer.plane_mm=0.4",
    "laser.tolerance_mm=0.6",
    "laser.sheet_tolerance=0.3",
    # what bends, breaks or rests on what it must not
    "optics.acrylic_mm=1",
    "light.axial_fit_mm=0.05",
    "shell.ledge_mm=0.2",
    "shell.ledge_drop_mm=0",
    "frame.seat_y_mm=0.3",
    # light and view
    "light.led_count=1",
    "light.led_count=2",
    "light.leds_per_m=72",  # five of them on two thirds of the ring
    "light.resistor_ohm=20",
    "light.resistor_ohm=100000",
    "optics.air_gap_mm=0.5",
    "optics.mm_per_px=0.02",
    "optics.image_width_px=1000",
    "optics.image_width_px=400",
    "skin.edge_fillet_mm=5",
    "camera.focal_length_mm=1.31",
    "camera.f_number=1.2",
)

RIGHT = (
    "skin.edge_fillet_mm=0.5",
    "optics.mm_per_px=0.037",
    "light.resistor_ohm=470",
    "light.resistor_ohm=1000",
    "light.slot_mm=4",
    "light.diffuser_mm=1.2",
    "light.wall_mm=1.3",
    "shell.cable_width_mm=18",
    "shell.cable_height_mm=2.5",
    "screw.engagement_mm=5",
    "screw.length_mm=18",
    "cover.peg_y_mm=7.8",
    "cover.lip_height_mm=1.0",  # not holder.clearance_mm=3.2, which is higher than the envelope
    "mount.kind=plate",
    "mount.length_mm=18",
    "mount.height_mm=8",
    "mount.width_mm=16",
    "mold.columns=1",
    "mold.web_mm=12",
    "mold.base_mm=5",
    "coupon.wells=6",
    "coupon.depth_mm=8",
    "fit_coupon.count=8",
    "fit_coupon.step_mm=0.05",
    "kerf_coupon.length_mm=60",
    "adapter.thickness_mm=10",
    "adapter.bolt_turn_deg=30",
    "stage_plate.thickness_mm=10",
    "stage_plate.grid_mm=50",
    "table.height_mm=8",
    "table.tab_mm=18",
    "tool.depth_mm=25",
    "tool.body_mm=18",
    "plate.force_n=30",
    "resin_printer.plane_mm=0.05",
    "laser.kerf_mm=0.3",
)

# The solids say so: walls, webs, grip, bending.
WRONG_ON_SOLIDS = (
    "light.wall_mm=0.4",
    "light.diffuser_mm=0.4",
    "shell.wall_mm=0.5",
    "cover.floor_mm=0.5",
    "screw.engagement_mm=2",
    "cover.leg_mm=0.3",
    "frame.wall_y_mm=1.6",
    "mold.web_mm=5.4",
    "fit_coupon.pitch_mm=3.6",
    "adapter.bolt_bore_mm=8",
    "table.hole_pitch_mm=5",
    "envelope.width_mm=38",
    "holder.screw_length_mm=2",
    "plate.force_n=200",
)


def names(rows: list[Row], key: str) -> bool:
    """Whether a row that fails names the key as what to change."""
    return any(row.verdict == "FAIL" and key in row.limit for row in rows)


@pytest.mark.parametrize("change", WRONG)
def test_a_wrong_number_is_refused_or_fails_and_its_row_says_what_to_change(change):
    key = change.partition("=")[0]
    try:
        design = load_design("deltact", [change])
    except InputError as why:
        rows = [Row("refused", "", "", str(why), False)]  # with the limits of its record
    else:
        rows = list(inequalities.rows(design))
        for arithmetic in ARITHMETIC:
            rows += advised(arithmetic, design)
        if all(row.passed for row in rows):
            rows += fits.platform(design)
    assert names(rows, key), [row for row in rows if not row.passed]
    told = [r.limit for r in rows if r.check != "refused" and f"{key}: " in r.limit]
    assert all(" or more" in limit or " or less" in limit for limit in told)


def checked(change: str) -> list[Row]:
    """Every row; one indenter stands for all."""
    tips = IndenterList(indenter=(ListedIndenter("sphere:10"),))
    return run(load_design("deltact", [change]), indenters=tips)


def test_where_every_number_has_its_default_all_are_moved():
    """A wall of 2 in place of 1.5, and a sum that two keys close alike, the least change first."""
    design = load_design()
    assert advice(design, lambda d: d.shell.wall_mm - 2.0) == "shell.wall_mm: 2.01 or more"
    told = advice(design, lambda d: 40.0 - 2 * d.skin.width_mm + 2 * d.skin.length_mm - 40.0)
    assert told == "skin.length_mm: 36.1 or more, skin.width_mm: 33.9 or less"
    assert advice(design, lambda d: -1.0) == ""


@pytest.mark.slow
@pytest.mark.parametrize("change", WRONG_ON_SOLIDS)
def test_a_wrong_number_fails_on_the_solids_and_its_row_names_it(change):
    rows = checked(change)
    assert names(rows, change.partition("=")[0]), [row for row in rows if not row.passed]


@pytest.mark.slow
@pytest.mark.parametrize("change", RIGHT)
def test_an_unusual_number_that_is_right_passes(change):
    rows = checked(change)
    assert [row for row in rows if not row.passed] == []
    assert len(rows) > 100
