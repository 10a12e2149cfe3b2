"""Labels on the page: each ends on a feature that its view shows, and crosses no text."""

from __future__ import annotations

import re

import numpy as np
import pytest
import shapely

from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.drafting.drawing import STANDARD_SCALES, drawing
from deltact_fab.fabricate.cad.drafting.page import Polylines, Text
from deltact_fab.fabricate.cad.drafting.projection import FLIPPED_VIEWS, SHEET_VIEWS, project_views
from deltact_fab.fabricate.cad.drafting.scheme import scheme
from deltact_fab.fabricate.cad.features import Round, features_of
from deltact_fab.fabricate.cad.kernel import require
from deltact_fab.fabricate.cad.mesh import mesh_solid
from deltact_fab.fabricate.cad.rays import Triangles

DRAWN = [part.name for part in registry.list_parts() if part.callouts is not None]
QUICK = ("nano17-adapter", "skin-frame")
MESH_MM, BESIDE_MM, NEAR_MM = 0.01, 0.03, 0.08
CASES = [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in DRAWN]


def bare(words):
    return re.sub(r" ±[\d.]+(?= |$)", "", words)


def leaders(page):
    """(view, path, text) of each label with a leader."""
    marks = page.marks
    for i, mark in enumerate(marks):
        if isinstance(mark, Polylines) and mark.style == "leader":
            text = next(m.text for m in marks[i:] if isinstance(m, Text))
            yield mark.group.removeprefix("dimensions-"), np.array(mark.lines[0]), text


def distance_mm(feature, hit):
    """How far a point is from a round's cylinder, a sphere, or one of another face's points."""
    if not isinstance(feature, Round):
        if feature.kind in ("SØ", "SR"):
            return abs(float(np.linalg.norm(hit - feature.centre)) - min(feature.sizes))
        return min(float(np.linalg.norm(hit - p)) for p, _ in feature.rim) / 2
    across = [i for i in range(3) if i != feature.axis]
    low, high = feature.low_mm[feature.axis], feature.high_mm[feature.axis]
    along = max(low - hit[feature.axis], hit[feature.axis] - high, 0.0)
    radius = np.hypot(*(hit - feature.low_mm)[across])
    return float(np.hypot(radius - feature.radius_mm, along))


def shown(solid, view, cut_x_mm, uv):
    """What a view shows at a point of its plane and beside it: points (n, 3)."""
    if cut_x_mm is not None:
        cq, box = require(), solid.BoundingBox()
        low = cq.Vector(cut_x_mm, box.ymin - 1, box.zmin - 1)
        room = cq.Solid.makeBox(box.xmax + 1 - cut_x_mm, box.ylen + 2, box.zlen + 2, low)
        solid = solid.intersect(room)
    right, up, back = view.axes
    turns = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    beside = BESIDE_MM * np.concatenate([np.stack([np.cos(turns), np.sin(turns)], 1), [[0, 0]]])
    start = (uv + beside) @ np.stack([right, up]) + 500 * back
    corners = mesh_solid(solid, MESH_MM, "view").corners_mm
    distance, _ = Triangles(corners).first_hit(start, np.tile(-back, (len(start), 1)))
    met = np.isfinite(distance)
    return start[met] - distance[met, None] * back


def unseen(name):
    """Labels whose leader does not end on a feature that the view shows, or crosses a text."""
    part, design = registry.find_part(name), load_design()
    solid, _ = build_part(part, design)
    callouts = part.callouts(part.source(design))
    page, features = drawing(part, design, solid), features_of(solid)
    plan, projections = scheme(features, callouts), project_views(solid, callouts)
    features_by_label = {group.label: group.members for group in plan.rounds}
    features_by_label |= {text: faces for faces, text in plan.other_faces}
    texts = [m for m in page.marks if isinstance(m, Text)]
    scale = STANDARD_SCALES[next(m.text for m in texts if m.text in STANDARD_SCALES)]
    views, wrong = FLIPPED_VIEWS if callouts.flipped else SHEET_VIEWS, []
    words = shapely.union_all([shapely.box(*m.box) for m in texts])
    for view, path, text in leaders(page):
        if shapely.LineString(path).intersects(words):
            wrong.append(f"{text}: through a text")
        if bare(text) not in features_by_label:
            assert text in [label.text for label in callouts.labels]
            continue
        drawn = np.array([
            point for m in page.marks if isinstance(m, Polylines) and m.group == f"view-{view}"
            and m.style in ("visible", "hidden", "smooth") for line in m.lines for point in line
        ])  # fmt: skip
        (x0, _), (_, y1) = projections[view].box_mm
        uv = np.array([x0, y1]) + (path[0] - drawn.min(axis=0)) / scale * (1, -1)
        cut = callouts.cut_x_mm if view == "left" else None
        hits = shown(solid, views[view], cut, uv)
        members = features_by_label[bare(text)]
        if not any(distance_mm(f, hit) < NEAR_MM for f in members for hit in hits):
            wrong.append(f"{text}: not seen in {view}")
    return wrong


@pytest.mark.parametrize("name", CASES)
def test_leaders_end_on_visible_features(name):
    assert unseen(name) == []


def test_section_shows_no_removed_half():
    cq = require()
    block = cq.Workplane().box(20, 20, 20)
    holes = block.cut(cq.Workplane("YZ", origin=(-11, 0, 5)).circle(2).extrude(6)).val()
    (hole,) = features_of(holes).rounds
    rim = np.array([2.0, 5.0])
    left = SHEET_VIEWS["left"]
    uv = np.array([float(left.axes[0] @ (0, rim[0], 0)), rim[1]])
    near = [distance_mm(hole, hit) for hit in shown(holes, left, None, uv)]
    assert min(near) < NEAR_MM
    assert min(distance_mm(hole, hit) for hit in shown(holes, left, 0.0, uv)) > 1
