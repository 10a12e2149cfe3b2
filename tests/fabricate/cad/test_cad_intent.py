"""A design solved for a face passes with no hand edit, or the change that a refusal names does."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from deltact_fab.app.lab import design as write
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad import check, feasibility, intent
from deltact_fab.fabricate.cad.check import arithmetic, visibility
from deltact_fab.fabricate.cad.design import IndenterList, ListedIndenter, load_camera, load_design
from deltact_fab.fabricate.cad.intent import Wish, failed_checks, find_design, solve_wish
from deltact_fab.fabricate.cad.parts.camera import off_axis
from deltact_fab.fabricate.cad.registry import design_parts
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
        pytest.param("17x17", 0.55, None, "face", marks=SLOW),
        pytest.param("36x34", 0.77, None, "share", marks=SLOW),
    ],
)
def test_refusal_suggests_passing_change(face, share, camera, key):
    with pytest.raises(InputError, match=rf"smallest change that passes: --{key} ") as told:
        solve_wish(Wish.parse(face, share, camera), BASE)
    typed = {"face": face, "share": share, "camera": camera}
    typed |= {key: str(told.value).rpartition(" ")[2]}
    mended = Wish.parse(typed["face"], float(typed["share"]), typed["camera"])
    assert list(failed_checks(find_design(mended, BASE), mended)) == []


@pytest.mark.parametrize(
    ("face", "share", "says"),
    [
        ("60x", 0.55, "--face '60x': expected two sides in mm, as in 60x50"),
        ("60x500", 0.55, "expected sides of 10 to 200 mm"),
        ("60x50", 1.5, "--share 1.5: expected 0.05 to 0.95"),
    ],
)
def test_invalid_wish_is_one_line(face, share, says):
    with pytest.raises(InputError, match=re.escape(says)):
        Wish.parse(face, share)


def test_new_file_reloads_same_design(tmp_path):
    wish = Wish.parse("24x24")
    path = write("tip", out=tmp_path / "tip.toml", wish=wish)
    assert load_design(str(path)) == find_design(wish, BASE)
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
            replace(c, id="bends") if c.id == "plate-deflection" else c for c in told(design, wish)
        ),
    )
    with pytest.raises(intent.Unsolved, match="plate deflection: "):
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
