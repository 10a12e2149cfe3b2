"""Pictures: what hides what, where the balloons stand, and the same bytes everywhere."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections import Counter

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from solids import made, of_group

from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.assembly import PlacedPart, assemble_sensor
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.drafting import picture
from deltact_fab.fabricate.cad.drafting.drawing import drawing
from deltact_fab.fabricate.cad.drafting.picture import (  # fmt: skip
    BALLOON_PITCH_MM,
    BALLOON_RADIUS_MM,
    TINT_SAMPLE_MM,
    arrange_balloons,
    regions,
    spread,
)
from deltact_fab.fabricate.cad.kernel import require
from deltact_fab.fabricate.cad.mesh import mesh_solid

SVG = "{http://www.w3.org/2000/svg}"
SENSOR = registry.parts_of_group("sensor")


@pytest.fixture(scope="module")
def cq():
    return require()


@pytest.fixture(scope="module")
def exploded():
    return ET.fromstring(exploded_svg(load_design(), of_group("sensor")))


def exploded_svg(design, solids):
    placed = assemble_sensor(design, 1.0, SENSOR, solids)
    return picture.picture_svg("exploded view", placed, picture.EXPLODED_VIEW, picture.EXPLODED_MM)


def part_svg(part, solid):
    placed = [PlacedPart(part, 0, solid, (0.0, 0.0, 0.0))]
    return picture.picture_svg(part.name, placed, room_mm=picture.PART_ROOM_MM, numbered=False)


def lines_of(root, group, style):
    """Polylines of one style in the groups of a name, {name: [(n, 2)]}."""
    found = {}
    for g in root.iter(f"{SVG}g"):
        kind, _, name = g.get("data-name").partition(" ")
        for path in g.iter(f"{SVG}path"):
            if kind == group and path.get("class") == style:
                parts = re.split("M", path.get("d"))[1:]
                lines = [np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", p), float) for p in parts]
                found.setdefault(name, []).extend(lines)
    return found


def shape(loops):
    """What loops hold by the even-odd rule."""
    whole = shapely.Polygon()
    for loop in loops:
        whole = whole.symmetric_difference(shapely.Polygon(loop).buffer(0))
    return whole


def page(root):
    return np.array([float(root.get(side).removesuffix("mm")) for side in ("width", "height")])


@pytest.mark.parametrize("name", ["screw", "mold", "indenter-ring"])
def test_part_fills_its_room(cq, name):
    root = ET.fromstring(part_svg(registry.find_part(name), made(name)))
    size, margin = page(root), picture.PICTURE_MARGIN_MM
    assert np.all(size <= np.array(picture.PART_ROOM_MM) + 1e-3)
    assert np.isclose(size, picture.PART_ROOM_MM, atol=1e-3).any()
    (lines,) = lines_of(root, "lines", "picture").values()
    points = np.concatenate(lines)
    assert np.allclose(points.min(axis=0), margin, atol=0.05)
    assert np.allclose(points.max(axis=0), size - margin, atol=0.05)


def test_region_is_visible_part_of_body(cq):
    view = picture.CORNER_VIEW
    box = cq.Solid.makeBox(3, 4, 5)
    # A box shows three faces, each foreshortened by its normal's part along the line of sight.
    want = sum(a * abs(n) for a, n in zip((4 * 5, 3 * 5, 3 * 4), view.axes[2], strict=True))
    (loops,) = regions([picture.mesh(box)], view, 10)
    assert shape(loops).area == pytest.approx(want, rel=0.01)
    # Nearer to the viewer, over the middle of the box.
    near = cq.Solid.makeBox(1, 1, 1).translate(cq.Vector(*(20 * view.axes[2] + (1, 1.5, 2))))
    behind, before = (shape(x) for x in regions([picture.mesh(box), picture.mesh(near)], view, 10))
    assert before.area == pytest.approx(sum(abs(view.axes[2])), rel=0.02)
    assert behind.area + before.area == pytest.approx(want, rel=0.01)
    assert behind.intersection(before).area < before.length * TINT_SAMPLE_MM / 10
    plate = cq.Workplane().box(20, 20, 1).faces(">Z").workplane().hole(8).val()
    (loops,) = regions([picture.mesh(plate)], picture.View((0, 0, -1), (0, 1, 0)), 5)
    assert len(loops) == 2
    assert shape(loops).area == pytest.approx(400 - np.pi * 16, rel=0.01)


@pytest.mark.slow
def test_visible_parts_have_one_balloon(exploded):
    found = Counter(
        name.removeprefix("balloon ")
        for g in exploded.iter(f"{SVG}g")
        if (name := g.get("data-name")).startswith("balloon ")
    )
    assert found == {part.name: 1 for part in SENSOR}
    said = Counter(e.text for e in exploded.iter(f"{SVG}text"))
    for part in SENSOR:
        if part.number:
            # In its balloon and in the legend.
            assert said[str(part.number)] == 2
    assert said["A"] == said["B"] == 2
    assert said["screw, 4×"] == 1


@pytest.mark.slow
def test_screws_share_axes_with_frame(exploded):
    (axes,) = [p for p in exploded.iter(f"{SVG}path") if p.get("class") == "centre"]
    assert axes.get("d").count("M") == 4
    design = load_design()
    assemblies = assemble_sensor(design, 1.0, [registry.find_part("skin")], of_group("sensor"))
    assert "centre" not in picture.picture_svg("skin", assemblies)


def test_hidden_part_has_no_balloon():
    one, other = registry.find_part("shell"), registry.find_part("cover")
    line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 8.0]])
    (balloon,) = arrange_balloons([(one, [line]), (other, [])], np.array([1.0, 0.0]))
    assert balloon.part is one


@pytest.mark.slow
def test_leaders_cross_no_line(exploded):
    drawn = {
        n: shapely.MultiLineString(x) for n, x in lines_of(exploded, "lines", "picture").items()
    }
    leaders = lines_of(exploded, "balloon", "thin")
    assert set(leaders) == {part.name for part in SENSOR}
    for name, (leader,) in leaders.items():
        rim, tip = leader
        assert drawn[name].distance(shapely.Point(tip)) < 0.01
        free = shapely.LineString([rim, tip + (rim - tip) * 0.3 / np.hypot(*(rim - tip))])
        assert not [other for other, lines in drawn.items() if lines.crosses(free)], name


@pytest.mark.slow
def test_fills_hide_no_visible_line(exploded):
    drawn = lines_of(exploded, "lines", "picture")
    for name, loops in lines_of(exploded, "piece", "filled").items():
        deep = shape(loops).buffer(-0.3)
        over = [n for n, lines in drawn.items() if n != name
                and shapely.MultiLineString(lines).intersects(deep)]  # fmt: skip
        assert not over, name


@pytest.mark.slow
def test_balloons_are_apart_on_page(exploded):
    circles = lines_of(exploded, "balloon", "picture")
    at = np.array([circle.mean(axis=0) for (circle,) in circles.values()])
    gaps = np.hypot(*(at[:, None] - at[None]).T) + 1e9 * np.eye(len(at))
    assert gaps.min() >= 2 * BALLOON_RADIUS_MM
    assert np.all(at - BALLOON_RADIUS_MM > 0)
    assert np.all(at + BALLOON_RADIUS_MM < page(exploded))


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=12))
def test_balloons_keep_order_and_distance(wanted):
    wanted = sorted(wanted)
    at = spread(wanted, BALLOON_PITCH_MM)
    assert np.all(np.diff(at) >= BALLOON_PITCH_MM - 1e-6)
    assert np.isclose(sum(at), sum(wanted), atol=1e-6)
    if len(wanted) == 1 or np.diff(wanted).min() >= BALLOON_PITCH_MM:
        assert np.allclose(at, wanted)


SCRIPT = """
import hashlib
from test_cad_picture import SENSOR, exploded_svg, part_svg
from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.drafting.drawing import drawing

design = load_design()
solids = {p.name: build_part(p, design)[0] for p in reversed(SENSOR)}
cover = registry.find_part("cover")
texts = [exploded_svg(design, solids), part_svg(cover, build_part(cover, design)[0])]
texts.append(drawing(cover, design, solids["cover"]).svg())
print(hashlib.sha256("".join(texts).encode()).hexdigest())
"""


@pytest.mark.slow
def test_leftover_mesh_changes_no_byte():
    design, cover, solids = load_design(), registry.find_part("cover"), of_group("sensor")
    texts = [exploded_svg(design, solids), part_svg(cover, solids["cover"])]
    texts.append(drawing(cover, design, solids["cover"]).svg())
    mesh_solid(solids["cover"], 0.2, "cover")
    assert part_svg(cover, solids["cover"]) == texts[1]
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONHASHSEED": "1", "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert done.stdout.strip() == hashlib.sha256("".join(texts).encode()).hexdigest()
