"""A design solved for a face passes with no hand edit, or the change that a refusal names does."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest
from click.testing import CliRunner

from benchmarks.cad_random import WRITTEN_SHARE, drawn, find_by_grid, outcome, written_share
from deltact_fab.app.cli.cad import cad
from deltact_fab.app.lab import design as write
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad import check, feasibility, intent
from deltact_fab.fabricate.cad.check import arithmetic, visibility
from deltact_fab.fabricate.cad.check.verdict import DesignVerdict
from deltact_fab.fabricate.cad.design import IndenterList, ListedIndenter, load_camera, load_design
from deltact_fab.fabricate.cad.intent import Wish, failed_checks, find_design
from deltact_fab.fabricate.cad.parts.camera import off_axis
from deltact_fab.fabricate.cad.parts.shell import cable_notch
from deltact_fab.fabricate.cad.registry import design_parts
from deltact_fab.fabricate.cad.solution import Solution, solve_wish
from deltact_fab.fabricate.cad.standards import parse_holes
from deltact_fab.sensor import LayeredPath

BASE = load_design()
SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("face", "camera"),
    [
        ("24x24", "innomaker-u20cam"),
        ("36x34", "imx219-200"),
        ("30x30", "arducam-b0152"),
        pytest.param("28x40", "rpi-camera-3-wide", marks=SLOW),
        pytest.param("60x50", "rpi-camera-2", marks=SLOW),
    ],
)
def test_wish_gives_design_that_passes(face, camera):
    wish = Wish.parse(face, camera=camera)
    design = find_design(wish, BASE)
    assert (design.skin.width_mm, design.skin.length_mm) == wish.face_mm
    assert list(failed_checks(design, wish)) == []
    x, y = design.optics.view_mm
    assert x * y >= 0.55 * design.skin.width_mm * design.skin.length_mm
    assert design.screw.length_mm in design.screw.row.stock_mm


@pytest.mark.parametrize(
    ("face", "share", "camera", "key"),
    [
        ("36x34", 0.55, "rpi-camera-3", "camera"),  # no face lets it focus nearer
        pytest.param("18x18", 0.55, None, "face", marks=SLOW),
        pytest.param("36x34", 0.85, None, "share", marks=SLOW),
    ],
)
def test_refusal_suggests_passing_change(face, share, camera, key):
    with pytest.raises(InputError, match=rf"smallest change that passes: --{key} ") as told:
        solve_wish(Wish.parse(face, share, camera), BASE, "wish")
    advice = re.search(rf"smallest change that passes: --{key} (\S+)", str(told.value))
    typed = {"face": face, "share": share, "camera": camera, key: advice[1]}
    mended = Wish.parse(typed["face"], float(typed["share"]), typed["camera"])
    assert list(failed_checks(find_design(mended, BASE), mended)) == []


@pytest.mark.parametrize(
    ("face", "share", "says"),
    [
        ("60x", 0.55, "--face '60x': expected two sides in mm, as in 60x50"),
        ("60x500", 0.55, "expected sides of 10 to 200 mm"),
        ("60x50", 1.5, "--share 1.5: expected 0.05 to 0.95"),
        ("30", 0.55, "--face '30': expected two sides in mm, as in 60x50 (no round faces)"),
    ],
)
def test_invalid_wish_is_one_line(face, share, says):
    with pytest.raises(InputError, match=re.escape(says)):
        Wish.parse(face, share)


def test_new_file_reloads_same_design(tmp_path):
    wish = Wish.parse("24x24")
    path = write("tip", out=tmp_path / "tip.toml", solution=find_design(wish, BASE), head=["Why."])
    assert load_design(str(path)) == find_design(wish, BASE)
    assert path.read_text().startswith("# Why.\n")
    text = path.read_text()
    assert "\nwidth_mm = 24.0\n" in text
    assert "\n#wall_mm = 1.5\n" in text


@SLOW
def test_solved_design_passes_solid_checks():
    one = IndenterList(indenter=(ListedIndenter("sphere:10"),))
    wish = Wish.parse("24x24", camera="innomaker-u20cam")
    rows = check.check_design(find_design(wish, BASE), indenters=one)
    assert [row for row in rows if row.failed] == []


def test_board_without_holes_is_bonded():
    bare = replace(BASE, camera=replace(BASE.camera, hole_mm=0.0))
    design = find_design(Wish.parse("36x34"), bare)
    assert design.holder.screw == "none"
    assert "camera-screw" not in [part.name for part in design_parts(design)]
    # It lies further off the middle than screws would have it.
    assert off_axis(design)[0].mean_mm > off_axis(BASE)[0].mean_mm


def test_remedies_ignore_check_texts(monkeypatch):
    """With every check renamed the same dimensions move; with its id changed nothing does."""
    wish, told = Wish.parse("60x50"), intent.failed_checks
    design = find_design(wish, BASE)

    def renamed(design, wish):
        return (replace(check, name="?", value="?", sign="") for check in told(design, wish))

    monkeypatch.setattr(intent, "failed_checks", renamed)
    assert find_design(wish, BASE) == design
    monkeypatch.setattr(
        intent,
        "failed_checks",
        lambda design, wish: (
            replace(c, id="light") if c.id == "even-light" else c for c in told(design, wish)
        ),
    )
    with pytest.raises(intent.Unsolved, match="even light: "):
        find_design(wish, BASE)


def test_every_remedy_has_a_check():
    """An id that nobody gives would leave its check without a remedy."""
    ids = {rule.id for rule in feasibility.rules(BASE)}
    for checks in (arithmetic.fits, arithmetic.light, visibility.view, arithmetic.bending):
        ids |= {check.id for check in checks(BASE)}
    small = replace(BASE.resin_printer, bed_x_mm=20.0, bed_y_mm=20.0)
    ids |= {check.id for check in arithmetic.platform(replace(BASE, resin_printer=small))}
    camera = load_camera("rpi-camera-3")
    ids |= {check.id for check in visibility.view(replace(BASE, camera=camera))}
    ids |= {rule.id for rule in feasibility.rules(turned())}
    ids |= {f"{kind}.light-holder" for kind in check.SOLID_CHECKS}
    assert set(intent.CHECK_REMEDIES) - ids == {"light-cone"}  # made by `failed_checks`


@pytest.mark.parametrize(
    ("changes", "room_mm"),
    [
        ({"connector_height_mm": 4.0}, 4.4),
        ({"cable_height_mm": 3.0}, 4.7),
        ({"board_mm": 2.1}, 3.4),  # its screws are 5 mm long
    ],
)
def test_clearance_behind_board_fits_highest(changes, room_mm):
    flat = replace(BASE.camera, connector_height_mm=1.0, cable_height_mm=0.5)
    design = find_design(Wish.parse("36x34"), replace(BASE, camera=replace(flat, **changes)))
    assert design.holder.clearance_mm == pytest.approx(room_mm)


def turned():
    """The base with its cable on another side, in a housing too small for that."""
    return replace(BASE, shell=replace(BASE.shell, cable_side="+x"))


def failed_rules(design) -> set[str]:
    return {rule.id for rule in feasibility.rules(design) if rule.failed}


@pytest.mark.parametrize(
    ("over_mm", "passes"), [(-0.7, True), (-0.3, False), (0.1, False), (1.4, False), (1.6, True)]
)
def test_thread_of_floor_fails_rule(over_mm, passes):
    """A ring that ends a little outside the relief of a camera screw leaves a thread of floor."""
    design = find_design(Wish.parse("44x40"), BASE)
    relief_mm = math.hypot(*design.camera_screw_centres_mm[0]) + design.head_relief_mm
    ring_mm = design.light_radius_mm - relief_mm - over_mm
    shell = replace(
        design.shell,
        ledge_mm=design.shell.ledge_mm + ring_mm,
        ledge_x_mm=design.shell.ledge_x_mm + ring_mm,
    )
    # Only the band: the ledges that make the ring so wide are not judged.
    failed = failed_rules(replace(design, shell=shell))
    assert ("light-holder.screw-outside" not in failed) == passes


def test_gel_is_kept_or_set():
    thin = replace(BASE, skin=replace(BASE.skin, thickness_mm=8.0, protrusion_mm=4.5))
    kept = find_design(Wish.parse("30x30"), thin).skin
    assert (kept.thickness_mm, kept.protrusion_mm) == (8.0, 4.5)
    skin = find_design(Wish.parse("30x30", gel_mm=6), thin).skin
    assert (skin.thickness_mm, skin.protrusion_mm, skin.edge_fillet_mm) == (6.0, 3.0, 1.0)
    with pytest.raises(InputError, match=r"--gel 1\.5: expected 2 to 60 mm"):
        Wish.parse("30x30", gel_mm=1.5)


@pytest.mark.parametrize("gel_mm", [pytest.param(2.0, marks=SLOW), 4.0])
def test_thin_gel_keeps_wall_of_frame(gel_mm):
    wish = Wish.parse("24x24", gel_mm=gel_mm)
    design = find_design(wish, BASE)
    assert list(failed_checks(design, wish)) == []
    assert design.skin.thickness_mm - design.skin.protrusion_mm >= 1.5
    flat = replace(design, skin=replace(design.skin, protrusion_mm=gel_mm - 0.5))
    assert "skin-frame.front" in failed_rules(flat)


@pytest.mark.parametrize(
    ("text", "thread", "count", "half_mm"),
    [
        ("30x30 M3", "M3", 4, (15.0, 15.0)),
        ("20x12.5  M4", "M4", 4, (10.0, 6.25)),
        ("circle 50 6xM4", "M4", 6, (25 * math.cos(math.pi / 6), 25.0)),
        ("iso 9409-1-50-4-m6", "M6", 4, (25.0, 25 / math.sqrt(2))),
    ],
)
def test_pattern_of_holes_is_parsed(text, thread, count, half_mm):
    pattern = parse_holes(text)
    assert (pattern.thread, len(pattern.centres_mm)) == (thread, count)
    assert pattern.half_mm == pytest.approx(half_mm)


@pytest.mark.parametrize("text", ["30x30", "30x30 M7", "circle 50 1xM4", "ISO 9409-1-50-7-M6", ""])
def test_wrong_pattern_is_one_line(text):
    with pytest.raises(InputError, match=r"--mount '.*': expected 30x30 M3, circle 50 6xM4 or ISO"):
        Wish.parse("36x34", holes=text)
    with pytest.raises(InputError, match="mount: holes"):
        load_design("deltact", [f'mount.holes="{text}"'])


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"width_mm": 50.0}, "width"),
        ({"length_mm": 40.0}, "length"),
        ({"height_mm": 4.0}, "root"),
        ({"height_mm": 20.0}, "front"),
        ({"holes": "circle 12 6xM6"}, "walls"),
        ({"holes": "circle 16 4xM6"}, "washers"),
        ({"stress_limit_mpa": 1.0}, "stress"),
    ],
)
def test_flange_rules_name_fault(change, rule):
    wish = Wish.parse("36x34", 0.5, holes="ISO 9409-1-50-4-M6")
    design = find_design(wish, BASE)
    assert design.mount.flange_screw_mm == 16.0
    assert failed_rules(design) == set()
    failed = failed_rules(replace(design, mount=replace(design.mount, **change)))
    assert f"shell.pattern-{rule}" in failed


def test_cable_turns_within_housing():
    assert failed_rules(turned()) == {"shell.cable-turn"}
    design = find_design(Wish.parse("36x34", 0.5, cable_side="+x"), BASE)
    assert failed_rules(design) == set()
    (x0, y0, _), (x1, y1, _) = cable_notch(design)
    assert x0 < design.cavity_half_mm[0] < design.frame_outer_mm[0] / 2 < x1
    assert y1 - y0 == pytest.approx(design.shell.cable_width_mm)
    assert y1 <= -design.holder_arm_mm
    with pytest.raises(InputError, match=r"--cable '\+y': expected one of -y, -x, \+x"):
        Wish.parse("36x34", cable_side="+y")


@SLOW
def test_failing_file_carries_its_faults(tmp_path):
    base = tmp_path / "base.toml"
    base.write_text('base = "deltact"\n[fit_coupon]\nstep_mm = 1.0\n')
    out = tmp_path / "tip.toml"
    command = ["new", "tip", "--base", str(base), "--face", "24x24", "-o", str(out)]
    result = CliRunner().invoke(cad, command)
    assert result.exit_code != 0
    head = out.read_text().partition("A design with")[0]
    assert re.search(r"1/\d+ checks failed", head)
    assert "wall thickness, fit-coupon" in head


@SLOW
def test_nearest_wish_passes():
    wish = Wish.parse("36x34", 0.85)
    solution = solve_wish(wish, BASE, "wish", nearest=True)
    assert solution.wish != wish
    assert solution.verdict.failed == []


def test_figures_of_thin_gel_follow():
    """A thin gel is stiffer, takes less depth, and is judged against the base."""
    wish = Wish.parse("24x24", gel_mm=4)
    solution = Solution(wish, BASE, find_design(wish, BASE), DesignVerdict("wish", ()))
    figures = {figure.name: figure for figure in solution.figures}
    gel, depth = figures["gel under a flat punch of 10 mm"], figures["depth of a press, largest"]
    assert gel.value > 2 * gel.base
    assert (depth.value, depth.base) == (1.67, 5.0)
    assert figures["gel"].value == 4.0
    assert figures["force of a press, largest"].value >= BASE.plate.force_n


@SLOW
def test_feasible_wishes_are_written():
    """Of sixty random wishes; what the solver refuses is tried by a grid that knows no remedy."""
    outcomes = []
    for index in range(60):
        wish, kind = drawn(index), "written"
        try:
            assert list(failed_checks(find_design(wish, BASE), wish)) == []
        except intent.Unsolved:
            kind = "refused" if find_by_grid(wish, BASE) else "infeasible"
        outcomes.append({"outcome": kind})
    assert written_share(outcomes) >= WRITTEN_SHARE
    solids = [outcome(index)["outcome"] for index in range(0, 60, 15)]
    assert set(solids) <= {"written", "refused", "infeasible"}


@pytest.mark.parametrize("camera", [None, "rpi-camera-2", "rpi-camera-3-wide", "innomaker-u20cam"])
def test_scale_no_finer_than_pixels(camera):
    """A pixel in the middle of the face, by the fisheye's own projection of two points."""
    design = find_design(Wish.parse("45x30", camera=camera), BASE)
    path = LayeredPath(design.optics.air_gap_mm, design.optics.acrylic_mm, design.skin.thickness_mm)
    raw_mm = 1e-4 / (path.half_angle_rad(1e-4) * design.focal_px)
    assert visibility.raw_mm_per_px(design) == pytest.approx(raw_mm, rel=1e-3)
    assert raw_mm <= design.optics.mm_per_px
    finer = replace(design, optics=replace(design.optics, mm_per_px=raw_mm / 1.11))
    assert "raw-pixel" in [row.id for row in visibility.view(finer) if row.failed]


def test_pattern_is_resolved(tmp_path, monkeypatch):
    (tmp_path / "patterns").mkdir()
    (tmp_path / "patterns/recommended.toml").write_text("patch_mm = 0.06\n")

    def failed():
        return [row.id for row in visibility.view(BASE) if row.failed]

    assert failed() == []
    monkeypatch.chdir(tmp_path)
    assert failed() == ["pattern-cell"]  # 0.0331 mm a pixel
