"""Drawings: what they say is the design's, and what they show is the solid, at the stated scale."""

from __future__ import annotations

import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
import shapely

from deltact_fab.cad import registry
from deltact_fab.cad.build import build_part
from deltact_fab.cad.design import load_design
from deltact_fab.cad.drafting.dimensioning import Callouts, Leader, Linear, shown, toleranced
from deltact_fab.cad.drafting.drawing import drawing
from deltact_fab.cad.drafting.layout import SCALES
from deltact_fab.cad.drafting.page import (
    CAP,
    GAP_MM,
    DrawingPage,
    Polylines,
    meet,
    text_width_mm,
)
from deltact_fab.cad.drafting.projection import View, project
from deltact_fab.cad.drafting.sheet import BORDER_MM, SHEETS, block_rect, wrapped
from deltact_fab.cad.drafting.views import FLIPPED, VIEWS
from deltact_fab.cad.kernel import require
from deltact_fab.cad.mesh import mesh_solid
from deltact_fab.errors import InputError

SVG = "{http://www.w3.org/2000/svg}"
PARTS = (
    "acrylic", "skin-frame", "transparent-base", "shell", "testing-shell", "light-holder",
    "camera-holder", "cover", "mold", "coupon-mold", "indenter-sphere-22", "indenter-4dots",
    "indenter-edges", "indenter-ellipsoid", "indenter-hexprism", "indenter-star", "indenter-ring",
    "indenter-hat",
)  # fmt: skip
VARYING = ("skin-frame", "acrylic", "testing-shell", "light-holder", "camera-holder", "mold")
FRONT = VIEWS["front"]


@pytest.fixture(scope="module")
def cq():
    return require()


@pytest.fixture(scope="module")
def made(cq):
    """A maker that keeps what it made: part and design -> (solid, box, drawing's root)."""
    kept = {}

    def make(name, design="deltact", *changes):
        key = (name, design, changes)
        if key not in kept:
            part, dims = registry.find(name), load_design(design, changes)
            solid, measured = build_part(part, dims)
            svg = drawing(part, dims, solid).svg()
            kept[key] = part, dims, solid, np.array(measured.box_mm), ET.fromstring(svg)
        return kept[key]

    return make


def texts(root):
    return [e.text for e in root.iter(f"{SVG}text")]


def text_boxes(root):
    """(words, left, top, right, bottom) of every text, from what the file says."""
    found = []
    for e in root.iter(f"{SVG}text"):
        x, y, height = float(e.get("x")), float(e.get("y")), float(e.get("font-size")) * CAP
        width = text_width_mm(e.text, height)
        left = {"start": 0.0, "middle": -width / 2, "end": -width}[e.get("text-anchor")]
        if e.get("transform"):
            assert e.get("transform").startswith("rotate(-90")
            found.append((e.text, (x - height, y - left - width, x, y - left)))
        else:
            found.append((e.text, (x + left, y - height, x + left + width, y)))
    return found


def struck(root):
    """Texts over which something is drawn, each with the style of the first line that does."""
    lines = []
    for path in root.iter(f"{SVG}path"):
        for part in path.get("d").split("M")[1:]:
            points = [tuple(map(float, p.split())) for p in part.rstrip("Z").split("L")]
            points += points[:1] if part.endswith("Z") else []
            lines += [(path.get("class"), pair) for pair in pairwise(points)]
    for ring in root.iter(f"{SVG}circle"):
        turn = np.linspace(0, 2 * np.pi, 91)
        points = np.stack([np.cos(turn), np.sin(turn)], axis=1) * float(ring.get("r"))
        points += (float(ring.get("cx")), float(ring.get("cy")))
        lines += [("circle", pair) for pair in pairwise(map(tuple, points.tolist()))]
    found = []
    for words, box in text_boxes(root):
        style = next((s for s, line in lines if _crosses(line, box)), None)
        if style is not None:
            found.append(f"{words!r} by {style}")
    return found


def _crosses(line, box):
    return shapely.LineString(line).crosses(shapely.box(*box))


def bare(words):
    """A printed length without its own limits."""
    return re.sub(r" ±[\d.]+(?= |$)", "", words)


def extent(group, *styles):
    """Width and height of the lines of a group."""
    data = " ".join(p.get("d") for p in group.iter(f"{SVG}path") if p.get("class") in styles)
    points = np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", data), float)
    return np.ptp(points, axis=0)


def view(root, name):
    return next(g for g in root.iter(f"{SVG}g") if g.get("id") == f"view-{name}")


# Projection


def test_a_box_shows_its_outline_and_hides_nothing_else(cq):
    box = cq.Solid.makeBox(10, 20, 30)
    (lines,) = project([box], FRONT.direction, FRONT.up)
    low, high = lines.box_mm
    assert np.allclose(low, (0, 0), atol=1e-9)
    assert np.allclose(high, (10, 30), atol=1e-9)
    # The back edges lie under the front ones.
    assert lines.hidden == ()
    assert len(lines.visible) == 1


def test_a_hole_is_hidden_from_the_side_and_round_from_above(cq):
    box = cq.Workplane().box(10, 20, 30).faces(">Z").workplane().hole(4, 12).val()
    (side,) = project([box], FRONT.direction, FRONT.up)
    hidden = np.concatenate(side.hidden)
    assert np.allclose(hidden.min(axis=0), (-2, 3), atol=1e-6)
    assert np.allclose(hidden.max(axis=0), (2, 15), atol=1e-6)
    chord_mm = 0.01
    (above,) = project([box], (0, 0, -1), (0, 1, 0), chord_mm)
    circle = next(line for line in above.visible if abs(np.ptp(line[:, 0]) - 4) < 0.1)
    radius = np.hypot(*circle.T)
    middles = np.hypot(*((circle[1:] + circle[:-1]) / 2).T)
    assert np.allclose(radius, 2, atol=1e-4)  # SAME_MM
    assert middles.min() > 2 - chord_mm


def test_a_solid_behind_another_keeps_its_own_hidden_lines(cq):
    near = cq.Solid.makeBox(10, 2, 10)
    far = cq.Solid.makeBox(4, 2, 4, cq.Vector(3, 5, 3))
    half = cq.Solid.makeBox(4, 2, 4, cq.Vector(8, 9, 3))
    front, behind, aside = project([near, far, half], FRONT.direction, FRONT.up)
    assert len(front.visible) == 1
    assert behind.visible == ()
    assert np.allclose(behind.box_mm, ((3, 3), (7, 7)), atol=1e-6)
    assert np.allclose(np.concatenate(aside.visible)[:, 0].min(), 10, atol=1e-6)
    assert np.allclose(np.concatenate(aside.hidden)[:, 0].max(), 10, atol=1e-6)


def test_one_solid_in_two_places_is_two(cq):
    box = cq.Solid.makeBox(2, 2, 2)
    moved = box.moved(cq.Location((5, 0, 0)))
    a, b = project([box, moved], FRONT.direction, FRONT.up)
    assert np.allclose(b.box_mm[0] - a.box_mm[0], (5, 0), atol=1e-9)


def test_a_view_needs_an_up_of_its_own():
    with pytest.raises(ValueError, match="parallel"):
        View((0, 0, 1), (0, 0, -2)).flat((1, 2, 3))


@pytest.mark.parametrize("views", [VIEWS, FLIPPED])
def test_the_views_belong_to_one_first_angle_drawing(views):
    """Front and top share x to the right; front and left share the upward axis; what the left view
    has on its right is what the top view has at its bottom, the side towards the reader."""
    front, top, left = (views[name].axes for name in ("front", "top", "left"))
    assert np.allclose(front[0], top[0])
    assert np.allclose(front[1], left[1])
    assert np.allclose(front[1], top[2])
    assert np.allclose(left[2], -front[0])
    assert np.allclose(left[0], -top[1])


# Drawings


@pytest.mark.parametrize("name", PARTS)
def test_the_lines_are_the_solid_at_the_stated_scale(made, name):
    _, _, _, box, root = made(name)
    size = box[1] - box[0]
    scale = SCALES[next(t for t in texts(root) if t in SCALES)]
    for which, want in (("front", size[[0, 2]]), ("top", size[:2]), ("left", size[1:])):
        drawn = extent(view(root, which), "visible", "hidden")
        # 0.005 mm of chord on the model, 0.001 of rounding on the sheet.
        assert np.allclose(drawn, want * scale, atol=0.01 * scale + 0.002), which


@pytest.mark.parametrize("name", PARTS)
def test_width_length_and_height_are_dimensioned(made, name):
    _, _, _, box, root = made(name)
    said = {bare(t).strip("Ø()") for t in texts(root)}
    for size in box[1] - box[0]:
        assert shown(size) in said


@pytest.mark.parametrize("name", PARTS)
def test_texts_lie_on_the_sheet_and_on_no_other(made, name):
    *_, root = made(name)
    found = text_boxes(root)
    for (a, box_a), (b, box_b) in combinations(found, 2):
        assert not meet(box_a, box_b), f"{a!r} over {b!r}"
    width, height = float(root.get("width")[:-2]), float(root.get("height")[:-2])
    assert (width, height) in SHEETS.values()
    assert root.get("viewBox") == f"0 0 {width:g} {height:g}"
    for words, (left, top, right, bottom) in found:
        assert min(left, top) > BORDER_MM, words
        assert max(right - width, bottom - height) < -BORDER_MM, words


@pytest.mark.parametrize(
    ("name", "change", "before", "after"),
    [
        ("skin-frame", "skin.width_mm=37", {"39", "36"}, {"40", "37"}),
        ("skin-frame", "screw.tip_clearance_mm=0.6", {"4× Ø1.35 depth 5.6"},
         {"4× Ø1.35 depth 5.2"}),
        ("acrylic", "optics.acrylic_mm=1.5", {"2"}, {"1.5"}),
        ("shell", "mount.hole_pitch_mm=12", {"10"}, {"12"}),
        ("shell", "mount.screw=M4", {"2× Ø3.4 through"}, {"2× Ø4.5 through"}),
        ("cover", "cover.peg_y_mm=7", {"16"}, {"14"}),
        ("camera-holder", "cover.peg_clearance_mm=0.05", {"4× Ø3.2 through for the cover's pegs"},
         {"4× Ø2.8 through for the cover's pegs"}),
        ("light-holder", "light.diffuser_mm=1.2", {"Ø20.2"}, {"Ø20.8"}),
        ("mold", "mold.web_mm=9", {"47", "102"}, {"48", "105"}),
        ("mold", "skin.edge_fillet_mm=1.5", {"16× R2 all around the floors"},
         {"16× R1.5 all around the floors"}),
        ("coupon-mold", "coupon.depth_mm=5", {"4× Ø15 depth 4"}, {"4× Ø15 depth 5"}),
        ("testing-shell", "table.tab_mm=16", {"67", "53"}, {"71", "55"}),
    ],
)  # fmt: skip
def test_what_is_printed_follows_the_design(made, name, change, before, after):
    old, new = (
        {bare(t) for t in texts(root)}
        for root in (made(name)[-1], made(name, "deltact", change)[-1])
    )
    assert before <= old
    assert after <= new


def test_the_title_block_names_the_part(made):
    part, *_, root = made("light-holder")
    said = texts(root)
    for words in (part.name, part.material, part.process, "±0.1 in the layers, ±0.15 across",
                  "mm", "2:1", "A3",
                  "DelTact sensor, part 4", "A–A", "1 of 1"):  # fmt: skip
        assert words in said
    assert any(words.startswith("deltact-fab ") for words in said)
    # Number, revision, date, owner and two names are the lab's to give.
    assert said.count("–") == 6
    lab = ("number=DT-100", "revision=B", "date=2026-11-23", "owner=A lab", "drawn_by=X Y",
           "approved_by=Z")  # fmt: skip
    *_, root = made("light-holder", "deltact", *(f"drawing.{said}" for said in lab))
    told = texts(root)
    assert "–" not in told
    for words in ("DT-100-light-holder", "B", "2026-11-23", "A lab", "X Y", "Z"):
        assert words in told


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("drawing.date=23.11.2026", "date: expected one as 2026-11-23: '23.11.2026' fails"),
        ("drawing.date=2026-02-30", "date: expected one as 2026-11-23"),
        ("drawing.owner=実験室", "owner: '実験室': the font has no '実'"),
        (f"drawing.number={'x' * 61}", "number: one line of at most 60 characters"),
    ],
)
def test_a_title_that_cannot_be_drawn_is_refused(change, says):
    with pytest.raises(InputError, match=re.escape(says)):
        load_design("deltact", [change])


def test_what_nobody_measured_is_named_on_the_drawing(made):
    *_, root = made("light-holder")
    note = next(t for t in texts(root) if t.startswith("Rests on unverified"))
    assert "camera.lens_height_mm" in note
    keys = [k.removeprefix("camera.") for k in load_design().unverified() if "camera." in k]
    *_, root = made("light-holder", "deltact", f"camera.measured={keys}")
    assert not any("unverified" in t for t in texts(root))


@pytest.mark.parametrize("name", PARTS)
def test_no_text_is_struck_through(made, name):
    *_, root = made(name)
    assert not struck(root)


@pytest.mark.parametrize("design", ["franka", "screws-19mm", "skin-30x34", "skin-44x40"])
@pytest.mark.parametrize(
    "name", ["shell", "cover", *(pytest.param(p, marks=pytest.mark.slow) for p in VARYING)]
)
def test_the_shipped_variants_are_drawn_without_overlaps(made, design, name):
    *_, root = made(name, design)
    for (a, box_a), (b, box_b) in combinations(text_boxes(root), 2):
        assert not meet(box_a, box_b), f"{a!r} over {b!r}"
    assert not struck(root)


def test_a_line_ends_at_a_text_and_a_text_through_a_wide_line_is_told():
    page = DrawingPage((100, 50), "test")
    page.text((20, 25), "36", anchor="middle")
    page.line((10, 24), (30, 24))
    assert not struck(ET.fromstring(page.svg()))
    (line,) = [mark for mark in page.broken() if isinstance(mark, Polylines)]
    ((_, (left, _)), ((right, _), _)) = line.lines
    width = text_width_mm("36")
    assert (left, right) == pytest.approx((20 - width / 2 - GAP_MM, 20 + width / 2 + GAP_MM))
    page.line((10, 24), (30, 24), "visible")
    assert struck(ET.fromstring(page.svg())) == ["'36' by visible"]


@pytest.mark.parametrize("name", PARTS)
def test_a_detail_is_larger_and_stays_in_its_circle(made, name):
    part, design, _, _, root = made(name)
    said = part.callouts(part.source(design))
    letters = {detail.letter for detail in said.details}
    for letter in letters:
        heading = next(t for t in texts(root) if t.startswith(f"{letter} ("))
        enlarged, parent = (
            view(root, letter),
            next(d.view for d in said.details if d.letter == letter),
        )
        scale, of = (float(v.get("data-scale")) for v in (enlarged, view(root, parent)))
        assert heading == f"{letter} ({scale:g}:1)"
        assert scale > of
        # The lines of a detail stay in its circle.
        ring = enlarged.find(f"{SVG}circle")
        centre, radius = (float(ring.get("cx")), float(ring.get("cy"))), float(ring.get("r"))
        data = " ".join(p.get("d") for p in enlarged.iter(f"{SVG}path"))
        points = np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", data), float)
        assert len(points) > 2
        assert np.hypot(*(points - centre).T).max() < radius + 0.002


# PDF


def test_the_pdf_is_the_same_drawing(made, tmp_path):
    part, design, solid, _, root = made("cover")
    path = tmp_path / "cover.pdf"
    path.write_bytes(drawing(part, design, solid).pdf())
    again = drawing(part, design, solid).pdf()
    assert path.read_bytes() == again
    assert b"/CreationDate" not in again
    if shutil.which("pdftotext") is None:
        pytest.skip("pdftotext is not installed")
    told = run("pdftotext", "-bbox", path, "-")
    page = re.search(r'<page width="([\d.]+)" height="([\d.]+)"', told)
    assert [float(v) * 25.4 / 72 for v in page.groups()] == pytest.approx((420, 297), abs=1e-3)
    words = re.findall(r"<word [^>]*>(.*?)</word>", told)
    assert sorted(words) == sorted(word for t in texts(root) for word in t.split())
    assert re.search(
        r"DeltactSans\s+CID TrueType\s+Identity-H\s+yes yes yes", run("pdffonts", path)
    )
    # Where a word stands, from the left: upright ones too.
    left, top = (
        float(v) * 25.4 / 72
        for v in re.search(r'xMin="([\d.]+)" yMin="([\d.]+)"[^>]*>cover<', told).groups()
    )
    at = next(e for e in root.iter(f"{SVG}text") if e.text == "cover")
    assert left == pytest.approx(float(at.get("x")), abs=0.05)
    assert top < float(at.get("y")) < top + 6


def run(*command):
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


# What a length says


def test_a_length_states_its_own_limits():
    assert [
        toleranced(35.8),
        toleranced(35.8, (-0.1, 0.0)),
        toleranced(3, (-0.1, 0.1)),
        toleranced(1.35, (-0.05, 0.1)),
        toleranced(2, (0.05, 0.1)),
    ] == ["35.8", "35.8 0/−0.1", "3 ±0.1", "1.35 +0.1/−0.05", "2 +0.1/+0.05"]
    with pytest.raises(ValueError, match=r"lower 0\.1 above upper -0\.1"):
        toleranced(3, (0.1, -0.1))
    assert Linear("top", (0, 0, 0), (3, 0, 0), "top", limits=(-0.1, 0)).words(VIEWS["top"]) == (
        "3 0/−0.1"
    )


def test_a_surface_states_flatness_and_roughness(cq):
    box = cq.Solid.makeBox(20, 10, 5)
    floor = Leader("front", (20, 5, 5), 0, "floor", flatness_mm=0.05, roughness_um=0.8)

    def said(_):
        return Callouts(labels=(floor,))

    shim = replace(registry.find("mold"), callouts=said)
    root = ET.fromstring(drawing(shim, load_design(), box).svg())
    assert {"floor", "0.05", "Ra 0.8", "±0.1 in the layers, ±0.15 across"} <= set(texts(root))
    assert "ISO 2768-m" not in texts(root)
    assert not struck(root)


def test_nothing_lies_on_the_title_block(made):
    for name in PARTS:
        *_, root = made(name)
        sheet = next(t for t in texts(root) if t in SHEETS)
        for group in root.iter(f"{SVG}g"):
            if group.get("id", "").startswith(("view", "dimensions", "picture")):
                data = " ".join(p.get("d") for p in group.iter(f"{SVG}path"))
                points = np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", data), float)
                if len(points):
                    left, top, _, _ = block_rect(sheet)
                    assert not ((points > (left, top)).all(axis=1)).any(), (name, group.get("id"))


@pytest.mark.slow
def test_a_mesh_left_on_the_solid_changes_no_byte(made):
    part, design, solid, *_ = made("cover")
    before = drawing(part, design, solid)
    svg, pdf = before.svg(), before.pdf()
    mesh_solid(solid, 0.1, part.name)
    after = drawing(part, design, solid)
    assert after.svg() == svg
    assert after.pdf() == pdf


@pytest.mark.parametrize("name", ["skin", "camera", "screw", "camera-screw"])
def test_what_is_cast_or_bought_has_no_drawing(name):
    part = registry.find(name)
    assert part.callouts is None
    with pytest.raises(InputError, match=f"part '{name}': has no drawing"):
        drawing(part, load_design(), None)


def test_a_part_that_fits_no_sheet_is_told(cq):
    with pytest.raises(InputError, match=r"acrylic: its drawing fits no A3 sheet at 1:5 \(4000 x"):
        drawing(registry.find("acrylic"), load_design(), cq.Solid.makeBox(4000, 4000, 2))


def test_lengths_are_printed_as_a_machinist_writes_them():
    assert [shown(v) for v in (36, 1.35, 10.0062, 0.1 + 0.2, -0.0, 16.666)] == [
        "36", "1.35", "10.01", "0.3", "0", "16.67",
    ]  # fmt: skip


def test_notes_are_wrapped_at_their_width():
    words = "one two three four five six seven eight nine ten"
    lines = wrapped(words, 30)
    assert " ".join(lines) == words
    assert len(lines) > 1
    assert all(text_width_mm(line) <= 30 for line in lines)
