"""Dimensions, their limits and their inequalities: what a lab edits, and what it hears of it."""

from __future__ import annotations

import dataclasses
import math

import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad import feasibility
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.parts.camera import BOARD_KEYS
from deltact_fab.fabricate.cad.rule import at_most, below, statement
from deltact_fab.fabricate.cad.sensor_sections import CameraDimensions, ScrewDimensions
from deltact_fab.sensor.shapes.bounded import ShapeError


def broken(*changes: str) -> list[str]:
    """Rules that fail for the default design with changes."""
    design = load_design("deltact", changes)
    return [f"{r.subject}: {statement(r)}" for r in feasibility.rules(design) if r.failed]


def test_shipped_design_matches_the_paper():
    design = load_design()
    assert design == Design()
    assert design.outer_mm == pytest.approx((39, 60, 30))
    assert design.frame_height_mm == pytest.approx(16 + 2 + 12 - 30 + 8)
    assert design.screw_at_mm == pytest.approx((16.225, 16.725))
    assert design.z_back_mm == pytest.approx(-30)
    # 30 = 16 (electronics) + 2 (acrylic) + 12 (silicone)
    assert design.z_joint_mm - design.z_back_mm == pytest.approx(16)
    assert [2 * s for s in design.acrylic_half_mm] == pytest.approx([35.8, 36.8])
    assert design.mold_outer_mm == pytest.approx((102, 104, 12))
    assert design.snap_strain == pytest.approx(0.0106, abs=5e-5)
    assert design.skin_volume_mm3 == pytest.approx(14140.63, abs=0.01)


def test_variant_inherits_from_its_base(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cad").mkdir()
    (tmp_path / "cad" / "deltact.toml").write_text("[skin]\nwidth_mm = 40.0\nlength_mm = 35.0\n")
    mine = tmp_path / "mine.toml"
    mine.write_text('base = "deltact"\n[skin]\nlength_mm = 33.0\n')
    design = load_design(str(mine))
    assert (design.skin.width_mm, design.skin.length_mm) == (40.0, 33.0)


def test_wrong_design_file_gives_one_line(tmp_path):
    mine, other = tmp_path / "mine.toml", tmp_path / "other.toml"
    other.write_text(f'base = "{mine}"\n')
    for text, says in (
        (f'base = "{other}"\n', r"mine\.toml: base: .* own base"),
        ("base = 3\n", r"mine\.toml: base: expected the name of a design .*got 3"),
        ("[frame]\npost = 6.0\n", r"mine\.toml: frame\.post: unknown key"),
    ):
        mine.write_text(text)
        with pytest.raises(InputError, match=says):
            load_design(str(mine))


def test_set_changes_numbers_words_and_lists():
    design = load_design(
        "deltact", ["skin.width_mm=44", "mount.kind=plate", 'camera.measured=["focal_length_mm"]']
    )
    assert design.skin.width_mm == 44
    assert design.mount.kind == "plate"
    assert "camera.focal_length_mm" not in design.unverified()
    assert "camera.lens_height_mm" in design.unverified()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("skin.width_mm", "expected section.key=value"),
        ("skin.widht_mm=44", "skin.widht_mm: unknown key; did you mean 'width_mm'"),
        ("skn.width_mm=44", "skn: unknown key; did you mean 'skin'"),
        ("skin.width_mm=wide", "skin.width_mm: must be a number without a unit"),
        ("skin.width_mm=nan", "skin"),
        ("skin.width_mm=0", "skin.width_mm: 0; expected 5 <= width_mm <= 200"),
        ("skin.edge_fillet_mm=6", "edge_fillet_mm < protrusion_mm"),
        ("screw.thread=M4", "screw.thread: must be 'M1.6', 'M2', 'M2.5' or 'M3'"),
        ("mount.kind=hook", "mount.kind"),
        ("mount.screw=M7", "mount.screw: must be 'M2'"),
        ('camera.measured=["pixel_um"]', "measured: of board_width_mm"),
        ("mold.columns=0", "expected 1 <= columns <= 8"),
        ("light.led_count=2.5", "light.led_count"),
    ],
)
def test_wrong_value_names_a_right_one(change, says):
    with pytest.raises(InputError) as caught:
        load_design("deltact", [change])
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_square_skin_is_refused():
    design = load_design("deltact", ["skin.width_mm=20", "skin.length_mm=20"])
    with pytest.raises(InputError) as caught:
        feasibility.check_feasible(design, "deltact")
    line = str(caught.value)
    assert line.startswith("deltact: ")
    assert " fails | " in line
    assert "\n" not in line


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ("frame.seat_y_mm=3", "skin-frame: half the acrylic's pocket in y < half the frame in y"),
        ("screw.engagement_mm=7.5", "skin-frame: screw.engagement_mm + screw.tip_clearance_mm"),
        ("resin_printer.least_hole_mm=1.4",
         "skin-frame: resin_printer.least_hole_mm <= pilot of screw.thread M1.6: 1.4 <= 1.35"),
        ("screw.length_mm=20", "screw: back of the sensor <= back of the screw heads (screw.len"),
        ("mount.height_mm=20", "shell: mount.height_mm <= depth of the shell"),
        ("mount.hole_pitch_mm=13.5", "shell: mount.hole_pitch_mm + washer M3 <= mount.length_mm"),
        ("mount.hole_pitch_mm=6", "shell: mount: washer M3 <= mount.hole_pitch_mm: 7 <= 6"),
        ("shell.cable_width_mm=24", "shell: cable_width_mm + 2 (cover.fit_mm + wall_mm) <= room"),
        ("shell.cable_height_mm=3 shell.ledge_height_mm=11", "shell: cable_height_mm + ledge_heig"),
        ("shell.ledge_height_mm=10", "shell: ledge_height_mm <= height of the posts: 10 <= 9.9"),
        ("shell.ledge_mm=5.1", "shell: ledge_mm + its distance from the wall <= posts bey"),
        ("mount.kind=franka mount.flange_pitch_mm=19", "shell: mount: flange_pitch_mm +"),
        ("mount.kind=franka mount.arm_mm=4", "shell: mount: arm_mm + counterbore_mm + 0.4 <= fla"),
        ("mount.kind=franka mount.arm_mm=2", "shell: mount: stress in arm_mm under plate.force_n"),
        ("mount.kind=franka mount.screw=M5", "shell: mount: head M5 + 0.5 <= counterbore_mm: 9"),
        ("mount.kind=franka mount.counterbore_depth_mm=5", "shell: mount: counterbore_depth_mm +"),
        ("mount.kind=franka mount.flange_mm=9", "shell: mount: flange under the head + 2.5 x M3"),
        ("mount.kind=franka mount.flange_width_mm=40", "shell: mount: flange_width_mm <= outer x"),
        ("mount.kind=franka mount.flange_height_mm=29", "shell: mount: front of the arm <= joint"),
        ("light.led_count=12", "light-holder: led_count x pitch <= 2 pi strip radius: 100"),
        ("light.strip_width_mm=10", "light-holder: strip_width_mm <= depth of the channel: 10"),
        ("cover.slot_mm=2.0", "cover: slot_mm / 2 + leg_mm < peg_mm / 2: 1.6 < 1.35"),
        ("cover.slot_mm=0.2 resin_printer.least_gap_mm=0.3",
         "cover: resin_printer.least_gap_mm <= cover.slot_mm: 0.3 <= 0.2"),
        ("cover.lip_height_mm=2.3", "cover: peg_play_mm + lip_height_mm <= camera.board_mm +"),
        ("mold.web_mm=4", "mold: fit_mm + pry_mm < web_mm / 2: 2.6 < 2"),
        ("mold.seat_mm=8", "mold: seat_mm < frame height: 8 < 8"),
        ("table.hole_pitch_mm=25", "testing-shell: table: pitch"),
        ("table.height_mm=17", "testing-shell: table.height_mm <= cover and shell: 17 <= 16"),
    ],
)  # fmt: skip
def test_each_inequality_can_fail(changes, says):
    found = broken(*changes.split())
    assert any(text.startswith(says) for text in found), found


def test_rule_marks_unverified_values():
    def rests_on(design):
        return {key for rule in feasibility.rules(design) for key in rule.basis}

    def of_camera(keys):
        return {key for key in keys if key.startswith("camera.")}

    # Fits and the rows of the view say on what they rest themselves.
    open_keys = of_camera(Design().unverified())
    assert of_camera(rests_on(Design())) == {
        "camera.lens_height_mm",
        "camera.lens_diameter_mm",
        "camera.cable_width_mm",
        *BOARD_KEYS,
    }
    assert rests_on(Design()) <= set(Design().unverified())
    keys = tuple(key.removeprefix("camera.") for key in open_keys)
    known = dataclasses.replace(Design(), camera=CameraDimensions(measured=keys))
    assert of_camera(rests_on(known)) == set()
    franka = load_design("franka", ['mount.measured=["flange_pitch_mm"]'])
    assert "mount.flange_pitch_mm" not in rests_on(franka)
    assert "mount.flange_height_mm" in rests_on(franka)


def test_nan_is_refused():
    with pytest.raises(ShapeError, match="length_mm"):
        ScrewDimensions(length_mm=math.nan)
    for rule in (below, at_most):
        assert rule("id", "a", math.nan, "b", 1.0).failed
        assert rule("id", "a", 0.0, "b", math.nan).failed


def test_dimensions_have_meaning_and_limits():
    design = Design()
    for section in dataclasses.fields(design):
        record = getattr(design, section.name)
        for f in dataclasses.fields(record):
            assert f.metadata["description"], f.name
            if "ge" in f.metadata:
                assert f.metadata["ge"] <= getattr(record, f.name) <= f.metadata["le"]
