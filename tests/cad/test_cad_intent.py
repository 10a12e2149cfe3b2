"""A design solved for a face passes with no hand edit, or the change that a refusal names does."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from deltact_fab.cad import check
from deltact_fab.cad.design import IndenterList, ListedIndenter, load_design
from deltact_fab.cad.intent import failures, solved, wish_of, wished
from deltact_fab.cad.parts.camera import off_axis
from deltact_fab.cad.registry import of_design
from deltact_fab.errors import InputError
from deltact_fab.lab import design as write

BASE = load_design()
CAMERAS = ("imx219-200", "rpi-camera-2", "rpi-camera-3-wide", "arducam-b0152", "innomaker-u20cam")
FACES = ("20x20", "24x24", "28x40", "30x30", "36x34", "44x40", "50x50", "60x50", "60x60", "80x60")


@pytest.mark.parametrize(("face", "camera"), [*zip(FACES, 2 * CAMERAS, strict=True)])
def test_a_wish_gives_a_design_on_which_all_arithmetic_holds(face, camera):
    wish = wish_of(face, camera=camera)
    design = solved(wish, BASE)
    assert (design.skin.width_mm, design.skin.length_mm) == wish.face_mm
    assert list(failures(design, wish)) == []
    x, y = design.optics.view_mm
    assert x * y >= 0.55 * design.skin.width_mm * design.skin.length_mm
    assert design.screw.length_mm in design.screw.row.stock_mm


@pytest.mark.parametrize(
    ("face", "share", "camera"),
    [
        ("10x60", 0.55, None),
        ("16x16", 0.55, None),
        ("36x34", 0.9, None),
        ("36x34", 0.55, "rpi-camera-3"),
    ],
)
def test_a_refusal_names_a_change_that_passes(face, share, camera):
    with pytest.raises(InputError, match=r"the smallest change that passes: --") as told:
        wished(wish_of(face, share, camera), BASE)
    key, value = re.search(r"--(face|share|camera) (\S+)$", str(told.value)).groups()
    typed = {"face": face, "share": share, "camera": camera} | {key: value}
    mended = wish_of(typed["face"], float(typed["share"]), typed["camera"])
    assert list(failures(solved(mended, BASE), mended)) == []


@pytest.mark.parametrize(
    ("face", "share", "says"),
    [
        ("60", 0.55, "--face '60': expected two sides in mm, as in 60x50"),
        ("60x", 0.55, "--face '60x': expected two sides"),
        ("nanx50", 0.55, "expected sides of 10 to 200 mm"),
        ("60x500", 0.55, "expected sides of 10 to 200 mm"),
        ("60x50", 1.5, "--share 1.5: expected 0.05 to 0.95"),
    ],
)
def test_what_is_no_wish_is_one_line(face, share, says):
    with pytest.raises(InputError, match=re.escape(says)):
        wish_of(face, share)


def test_the_file_states_what_differs_from_its_base_and_gives_the_same_design(tmp_path):
    wish = wish_of("24x24")
    path = write("tip", out=tmp_path / "tip.toml", wish=wish)
    assert load_design(str(path)) == solved(wish, BASE)
    text = path.read_text()
    assert "\nwidth_mm = 24.0\n" in text
    assert "\n#wall_mm = 1.5\n" in text


@pytest.mark.slow
@pytest.mark.parametrize(("face", "camera"), [("24x24", CAMERAS[4]), ("80x60", CAMERAS[1])])
def test_a_solved_design_passes_every_check_on_its_solids(face, camera):
    one = IndenterList(indenter=(ListedIndenter("sphere:10"),))
    rows = check.run(solved(wish_of(face, camera=camera), BASE), indenters=one)
    assert [row for row in rows if not row.passed] == []


def test_a_board_without_holes_is_bonded_and_takes_no_screws():
    bare = replace(BASE, camera=replace(BASE.camera, hole_mm=0.0))
    design = solved(wish_of("36x34"), bare)
    assert design.holder.screw == "none"
    assert "camera-screw" not in [part.name for part in of_design(design)]
    assert "camera-screw" in [part.name for part in of_design(BASE)]
    # It lies further off the middle than screws would have it.
    assert off_axis(design)[0].mean_mm > off_axis(BASE)[0].mean_mm
