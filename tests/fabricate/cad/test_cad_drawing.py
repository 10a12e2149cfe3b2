"""Drawings: what they say is the design's, and what they show is the solid, at the stated scale."""

from __future__ import annotations

import html
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
import shapely

from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.drafting.dimensioning import Callouts, Leader, Span, fmt, toleranced
from deltact_fab.fabricate.cad.drafting.drawing import STANDARD_SCALES, drawing
from deltact_fab.fabricate.cad.drafting.page import (  # fmt: skip
    BORDER_MM,
    FORMATS_MM,
    TEXT_GAP_MM,
    DrawingPage,
    Polylines,
    Text,
    block_rect,
    overlap,
    text_width_mm,
)
from deltact_fab.fabricate.cad.drafting.projection import FLIPPED_VIEWS, SHEET_VIEWS, project
from deltact_fab.fabricate.cad.drafting.wiring import wiring
from deltact_fab.fabricate.cad.kernel import require

SVG = "{http://www.w3.org/2000/svg}"
QUICK = ("acrylic", "skin-frame", "light-holder")  # a plate, seen from its back, with a section
VARYING = ("skin-frame", "acrylic", "shell", "light-holder", "camera-holder", "cover", "mold")
DRAWN = [part.name for part in registry.list_parts() if part.callouts is not None]
FRONT = SHEET_VIEWS["front"]


@pytest.fixture(scope="module")
def cq():
    return require()


@pytest.fixture(scope="module")
def made(cq):
    """A maker that keeps what it made: part and design -> (part, solid, box, page)."""
    kept = {}

    def make(name, design="deltact", *changes):
        key = (name, design, changes)
        if key not in kept:
            part, dims = registry.find_part(name), load_design(design, changes)
            solid, measured = build_part(part, dims)
            kept[key] = part, solid, np.array(measured.box_mm), drawing(part, dims, solid)
        return kept[key]

    return make


def texts(page):
    return [mark.text for mark in page.marks if isinstance(mark, Text)]


def bare(words):
    """A printed length without its own limits."""
    return re.sub(r" ±[\d.]+(?= |$)", "", words)


def points(page, group, *styles):
    """Corners of the lines of a group."""
    return np.array([
        point for mark in page.marks if isinstance(mark, Polylines) and mark.group == group
        and mark.style in (styles or (mark.style,)) for line in mark.lines for point in line
    ])  # fmt: skip


def faults(page):
    """Texts on one another, off the sheet, or under a line; lines on the title block."""
    found = []
    words = [mark for mark in page.marks if isinstance(mark, Text)]
    for a, b in combinations(words, 2):
        if overlap(a.box, b.box):
            found.append(f"{a.text!r} over {b.text!r}")
    edge = [BORDER_MM, BORDER_MM, *(side - BORDER_MM for side in page.size_mm)]
    for mark in words:
        left, top, right, bottom = mark.box
        if left < edge[0] or top < edge[1] or right > edge[2] or bottom > edge[3]:
            found.append(f"{mark.text!r} off the sheet")
    sheet = next(name for name, size in FORMATS_MM.items() if size == page.size_mm)
    block = shapely.box(*block_rect(sheet))
    for mark in page.broken():
        if isinstance(mark, Polylines):
            lines = [(*line, line[0]) if mark.closed else line for line in mark.lines]
            drawn = shapely.MultiLineString([pair for line in lines for pair in pairwise(line)])
            found += [
                f"{text.text!r} struck by {mark.style}"
                for text in words
                if drawn.crosses(shapely.box(*text.box))
            ]
            if mark.group != "sheet" and drawn.crosses(block):
                found.append(f"{mark.group} on the title block")
    return found


# Projection


def test_box_shows_only_its_outline(cq):
    (lines,) = project([cq.Solid.makeBox(10, 20, 30)], FRONT)
    assert np.allclose(lines.box_mm, ((0, 0), (10, 30)), atol=1e-9)
    # The back edges lie under the front ones.
    assert lines.hidden == ()
    assert len(lines.visible) == 1


def test_hole_is_hidden_or_round(cq):
    box = cq.Workplane().box(10, 20, 30).faces(">Z").workplane().hole(4, 12).val()
    (side,) = project([box], FRONT)
    hidden = np.concatenate(side.hidden)
    assert np.allclose(hidden.min(axis=0), (-2, 3), atol=1e-6)
    assert np.allclose(hidden.max(axis=0), (2, 15), atol=1e-6)
    chord_mm = 0.01
    (above,) = project([box], SHEET_VIEWS["top"], chord_mm)
    circle = next(line for line in above.visible if abs(np.ptp(line[:, 0]) - 4) < 0.1)
    middles = np.hypot(*((circle[1:] + circle[:-1]) / 2).T)
    assert np.allclose(np.hypot(*circle.T), 2, atol=1e-4)  # SAME_MM
    assert middles.min() > 2 - chord_mm


def test_solid_behind_keeps_hidden_lines(cq):
    near = cq.Solid.makeBox(10, 2, 10)
    far = cq.Solid.makeBox(4, 2, 4, cq.Vector(3, 5, 3))
    half = far.moved(cq.Location((5, 4, 0)))
    front, behind, aside = project([near, far, half], FRONT)
    assert len(front.visible) == 1
    assert behind.visible == ()
    assert np.allclose(behind.box_mm, ((3, 3), (7, 7)), atol=1e-6)
    assert np.allclose(np.concatenate(aside.visible)[:, 0].min(), 10, atol=1e-6)
    assert np.allclose(np.concatenate(aside.hidden)[:, 0].max(), 10, atol=1e-6)


@pytest.mark.parametrize("views", [SHEET_VIEWS, FLIPPED_VIEWS])
def test_views_are_first_angle_projection(views):
    """Front and top share x to the right; front and left share the upward axis; what the left view
    has on its right is what the top view has at its bottom, the side towards the reader."""
    front, top, left = (views[name].axes for name in ("front", "top", "left"))
    assert np.allclose(front[0], top[0])
    assert np.allclose(front[1], left[1])
    assert np.allclose(front[1], top[2])
    assert np.allclose(left[2], -front[0])
    assert np.allclose(left[0], -top[1])


# Drawings


@pytest.mark.parametrize(
    "name",
    [
        *QUICK, pytest.param("shell", marks=pytest.mark.slow),
        pytest.param("mold", marks=pytest.mark.slow),
        *(pytest.param(n, marks=pytest.mark.evidence) for n in DRAWN
          if n not in (*QUICK, "shell", "mold")),
    ],
)  # fmt: skip
def test_drawing_is_to_scale_and_legible(made, name):
    _, _, box, page = made(name)
    size, said = box[1] - box[0], texts(page)
    scale = STANDARD_SCALES[next(t for t in said if t in STANDARD_SCALES)]
    for which, want in (("front", size[[0, 2]]), ("top", size[:2]), ("left", size[1:])):
        drawn = np.ptp(points(page, f"view-{which}", "visible", "hidden"), axis=0)
        # 0.005 mm of chord on the model.
        assert np.allclose(drawn, want * scale, atol=0.01 * scale), which
    assert {fmt(side) for side in size} <= {bare(t).strip("Ø()") for t in said}
    assert faults(page) == []


@pytest.mark.parametrize(
    ("design", "names"),
    [
        pytest.param("franka", ["shell"], marks=pytest.mark.slow),
        pytest.param("skin-44x40", VARYING, marks=pytest.mark.evidence),
        pytest.param("large-60x50", VARYING, marks=pytest.mark.slow),
    ],
)
def test_the_shipped_variants_are_legible(made, design, names):
    found = {name: faults(made(name, design)[-1]) for name in names}
    assert not any(found.values()), found


@pytest.mark.parametrize(
    ("name", "change", "before", "after"),
    [
        ("skin-frame", "skin.width_mm=37", {"39", "36"}, {"40", "37"}),
        ("skin-frame", "screw.tip_clearance_mm=0.6", {"4× M1.6 × 0.35, pilot Ø1.35 depth 5.6"},
         {"4× M1.6 × 0.35, pilot Ø1.35 depth 5.2"}),
        ("light-holder", "light.diffuser_mm=1.2", {"Ø20.2"}, {"Ø20.8"}),
        ("light-holder", "camera.lens_height_mm=20 light.floor_mm=1.9",
         {"1.5", "4× R1.97 depth 1.5 for the lips of the pegs"},
         {"1.9", "4× R1.97 depth 1.9 for the lips of the pegs"}),
        pytest.param("mold", "mold.floor_roughness_um=0.4",
                     {"floor, the touched face, flat within 0.05, Ra 0.8"},
                     {"floor, the touched face, flat within 0.05, Ra 0.4"}, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_what_is_printed_follows_the_design(made, name, change, before, after):
    assert before <= {bare(t) for t in texts(made(name)[-1])}
    assert after <= {bare(t) for t in texts(made(name, "deltact", *change.split())[-1])}


def test_title_block_is_complete(made):
    part, _, _, page = made("light-holder")
    said = texts(page)
    for words in (part.name, part.material, part.process, "±0.1 in the layers, ±0.15 across",
                  "mm", "2:1", "A3", "DelTact sensor, part 4", "A–A", "1 of 1"):  # fmt: skip
        assert words in said
    assert any(words.startswith("deltact-fab ") for words in said)
    # Number, revision, date, owner and two names are the lab's to give.
    assert said.count("–") == 6
    lab = ("number=DT-100", "revision=B", "date=2026-11-23", "owner=A lab", "drawn_by=X Y",
           "approved_by=Z")  # fmt: skip
    told = texts(made("light-holder", "deltact", *(f"drawing.{said}" for said in lab))[-1])
    assert {"DT-100-light-holder", "B", "2026-11-23", "A lab", "X Y", "Z"} <= {*told} - {"–"}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("drawing.owner=実験室", "owner: '実験室': the font has no '実'"),
        (f"drawing.number={'x' * 61}", "number: expected one line of at most 60 characters"),
    ],
)
def test_undrawable_title_is_refused(change, says):
    with pytest.raises(InputError, match=re.escape(says)):
        load_design("deltact", [change])


@pytest.mark.parametrize(
    "changes",
    [
        ("light.resistor_ohm=470", "drawing.revision=C"),
        ("light.led_count=21", "light.leds_per_m=400", "light.strip_w_per_m=14.4"),
    ],
)
def test_wiring_is_legible_and_complete(changes):
    page = wiring(load_design(changes=changes))
    assert faults(page) == []
    if "drawing.revision=C" in changes:
        said = ("R 470 ohm", "12 V ± 5 %", "red, 0.08 mm²", "17 × 2 mm", ">C<", "cut 2")
        assert [text for text in said if text not in page.svg()] == []


def test_drawing_names_unverified_keys(made):
    note = next(t for t in texts(made("light-holder")[-1]) if t.startswith("Depends on unverified"))
    assert "camera.lens_height_mm" in note
    keys = [k.removeprefix("camera.") for k in load_design().unverified() if "camera." in k]
    page = made("light-holder", "deltact", f"camera.measured={keys}")[-1]
    assert not any("unverified" in t for t in texts(page))


def test_wide_line_through_text_is_fault():
    page = DrawingPage(FORMATS_MM["A4"], "test")
    page.text((40, 25), "36", anchor="middle")
    page.line((20, 24), (60, 24))
    assert faults(page) == []
    (line,) = [mark for mark in page.broken() if isinstance(mark, Polylines)]
    ((_, (left, _)), ((right, _), _)) = line.lines
    half = text_width_mm("36") / 2 + TEXT_GAP_MM
    assert (left, right) == pytest.approx((40 - half, 40 + half))
    page.line((20, 24), (60, 24), "visible")
    assert faults(page) == ["'36' struck by visible"]


def test_hatching_spares_holes():
    page = DrawingPage((60, 60), "test")
    face, hole = shapely.box(10, 10, 50, 40), shapely.box(20, 20, 30, 30)
    page.hatch([face.exterior.coords, hole.exterior.coords])
    (mark,) = page.marks
    drawn = shapely.MultiLineString(mark.lines)
    assert drawn.within(face.difference(hole).buffer(1e-9))
    # Lines 2 mm apart fill an area with half a millimetre a square millimetre.
    assert drawn.length == pytest.approx((1200 - 100) / 2, rel=0.03)


def test_svg_and_pdf_show_same_page(made, tmp_path):
    *_, page = made("light-holder")
    root = ET.fromstring(page.svg())
    assert [root.get(side) for side in ("width", "height")] == ["420mm", "297mm"]
    assert [e.text for e in root.iter(f"{SVG}text")] == texts(page)
    front = next(g for g in root.iter(f"{SVG}g") if g.get("data-name") == "view-front")
    path = next(p for p in front if p.get("class") == "visible")
    assert (path.get("stroke-width"), path.get("fill")) == ("0.5", "none")
    path = tmp_path / "holder.pdf"
    path.write_bytes(page.pdf())
    assert b"/CreationDate" not in path.read_bytes()
    if shutil.which("pdftotext") is None:
        pytest.skip("pdftotext is not installed")
    told = subprocess.check_output(["pdftotext", "-bbox", path, "-"], text=True)
    size = re.search(r'<page width="([\d.]+)" height="([\d.]+)"', told).groups()
    assert [float(v) * 25.4 / 72 for v in size] == pytest.approx((420, 297), abs=1e-3)
    words = re.findall(r"<word [^>]*>(.*?)</word>", html.unescape(told))
    assert sorted(words) == sorted(word for t in texts(page) for word in t.split())
    fonts = subprocess.check_output(["pdffonts", path], text=True)
    assert re.search(r"DeltactSans\s+CID TrueType\s+Identity-H\s+yes yes yes", fonts)
    left, top = (
        float(v) * 25.4 / 72
        for v in re.search(r'xMin="([\d.]+)" yMin="([\d.]+)"[^>]*>light-holder<', told).groups()
    )
    at = next(mark.position for mark in page.marks if getattr(mark, "text", "") == "light-holder")
    assert left == pytest.approx(at[0], abs=0.05)
    assert top < at[1] < top + 6


# What a length says


def test_length_is_printed_with_limits():
    assert [fmt(v) for v in (36, 1.35, 10.0062, 0.1 + 0.2, -0.0, 16.666)] == [
        "36", "1.35", "10.01", "0.3", "0", "16.67",
    ]  # fmt: skip
    assert [toleranced(35.8), toleranced(3, 0.1)] == ["35.8", "3 ±0.1"]
    assert Span(0, 1, 4, auxiliary=True).text(0.1) == "(3 ±0.1)"
    assert Span(0, 1, 4, prefix="Ø", fitted=False).text(0.1) == "Ø3"


def test_leader_arrow_ends_on_rim(cq):
    plate = cq.Workplane().box(20, 10, 5, centered=False).val()
    hole = Leader("top", (20, 5, 5), 2, "hole")
    shim = replace(registry.find_part("mold"), callouts=lambda _: Callouts(labels=(hole,)))
    page = drawing(shim, load_design(), plate)
    tips = [
        mark.lines[0][0] for mark in page.marks
        if isinstance(mark, Polylines) and mark.style == "filled" and mark.group[-3:] == "top"
    ]  # fmt: skip
    (left, top), (right, _) = (f(points(page, "view-top"), axis=0) for f in (np.min, np.max))
    at, scale = ((right), top + (right - left) / 4), (right - left) / 20
    assert min(abs(np.hypot(*(np.array(tip) - at)) - 2 * scale) for tip in tips) < 1e-6


def test_bought_or_oversized_part_is_undrawn(cq):
    with pytest.raises(InputError, match="part 'screw': no drawing"):
        drawing(registry.find_part("screw"), load_design(), None)
    with pytest.raises(InputError, match=r"acrylic: its drawing fits no A3 sheet at 1:5 \(4000 x"):
        drawing(registry.find_part("acrylic"), load_design(), cq.Solid.makeBox(4000, 4000, 2))
