"""Each quantity of each feature, changed by 0.5 mm, changes a number in the drawing's PDF."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.drafting import drawing as drafting
from deltact_fab.fabricate.cad.drafting import scheme as schemes
from deltact_fab.fabricate.cad.drafting.dimensioning import Callouts
from deltact_fab.fabricate.cad.drafting.scheme import scheme
from deltact_fab.fabricate.cad.features import closes, features_of
from deltact_fab.fabricate.cad.kernel import require

DRAWN = [part.name for part in registry.list_parts() if part.callouts is not None]
QUICK = ("tool-holder", "light-holder")
STEP_MM, LESS_MM, TURN_DEG, SAME_MM = 0.5, 0.4, 1.0, 1e-6
CASES = [pytest.param(n, marks=pytest.mark.slow if n in QUICK else pytest.mark.evidence)
         for n in DRAWN]  # fmt: skip


def step(axis, by_mm=STEP_MM):
    return np.eye(3)[axis] * by_mm


def moved(point, by):
    return tuple((np.array(point) + by).tolist())


def solids(solid):
    """(feature, quantity, solid): each flat face pulled out; each hole moved, wider, deeper."""
    cq = require()
    for r in features_of(solid).rounds:
        if not (r.hole and r.full_turn):
            continue

        def pin(by=(0, 0, 0), wider_mm=0.0, longer=(0.0, 0.0), r=r):
            low = np.array(r.low_mm) - step(r.axis, longer[0]) + by
            return cq.Solid.makeCylinder(r.radius_mm + wider_mm / 2, r.length_mm + sum(longer),
                                         cq.Vector(*low), cq.Vector(*step(r.axis, 1)))  # fmt: skip

        name, plugged = f"hole Ø{2 * r.radius_mm:g} at {r.low_mm}", solid.fuse(pin())
        for axis in {0, 1, 2} - {r.axis}:
            yield name, "xyz"[axis], plugged.cut(pin(step(axis))).clean()
        yield name, "diameter", solid.cut(pin(wider_mm=STEP_MM)).clean()
        if r.blind:
            longer = (STEP_MM, 0.0) if r.blind == "low" else (0.0, STEP_MM)
            yield name, "depth", solid.cut(pin(longer=longer)).clean()
    corners = np.array([v.toTuple() for v in solid.Vertices()])
    for face in solid.Faces():
        normal = face.normalAt()
        n, centre = np.array(normal.toTuple()), np.array(face.Center().toTuple())
        if face.geomType() != "PLANE" or np.abs(n).max() < 1 - 1e-9:
            continue
        # A step that is gone has no length.
        gone = np.abs(corners @ n - centre @ n - STEP_MM).min() < SAME_MM
        wires = face.outerWire(), face.innerWires()
        slab = cq.Solid.extrudeLinear(*wires, normal * (LESS_MM if gone else STEP_MM))
        try:
            yield (
                f"face at {centre.round(3).tolist()}",
                "xyz"[np.abs(n).argmax()],
                solid.fuse(slab).clean(),
            )
        except ValueError:  # the kernel gives nothing where the slab touches its neighbours
            continue


def carried(features, axis, at_mm, by_mm, beside=lambda _: True):
    """The features with the ends of rounds and edges at a coordinate moved along an axis."""

    def shift(point):
        return moved(point, step(axis, by_mm)) if abs(point[axis] - at_mm) < SAME_MM else point

    rounds, edges = (
        tuple(replace(r, low_mm=shift(r.low_mm), high_mm=shift(r.high_mm))
              if r.axis == axis and beside(r) else r for r in group)
        for group in (features.rounds, features.edges)
    )  # fmt: skip
    return replace(features, rounds=rounds, edges=edges)


def with_box(features, old, new, axis):
    """The features with the end of the box moved from one coordinate to another."""
    low, high = list(features.low_mm), list(features.high_mm)
    for ends in (low, high):
        if abs(ends[axis] - old) < SAME_MM:
            ends[axis] = new
    return replace(features, low_mm=tuple(low), high_mm=tuple(high))


def reshaped(features, i, by=(0, 0, 0), wider_mm=0.0):
    """The features with a round moved and its radius changed, with its edges and the box."""
    r = features.rounds[i]

    def one(e):
        ends = {name: moved(getattr(e, name), by) for name in ("low_mm", "high_mm", "point")}
        return replace(e, **ends, radius_mm=e.radius_mm + wider_mm)

    new = replace(
        features,
        rounds=tuple(one(e) if j == i else e for j, e in enumerate(features.rounds)),
        edges=tuple(one(e) if coaxial(r, e) else e for e in features.edges),
    )
    for axis in {0, 1, 2} - {r.axis}:
        for sign in (-1, 1):
            old = r.low_mm[axis] + sign * r.radius_mm
            new = with_box(new, old, old + by[axis] + sign * wider_mm, axis)
    return new


def coaxial(r, e):
    """True if an edge or a round has the axis and the radius of another."""
    off = np.delete(np.subtract(e.low_mm, r.low_mm), r.axis)
    return e.axis == r.axis and max(*abs(off), abs(e.radius_mm - r.radius_mm)) < SAME_MM


def rounds(features):
    """(feature, quantity, features): arcs and bosses wider, moved, deeper, longer."""
    for i, r in enumerate(features.rounds):
        if r.hole and r.full_turn:
            continue
        name = f"{'arc' if r.turn_deg < 359 else 'boss'} R{r.radius_mm:g} at {r.low_mm}"
        yield name, "diameter", reshaped(features, i, wider_mm=STEP_MM / 2)
        if not r.rounds_an_edge:  # else it lies between its two faces
            for axis in {0, 1, 2} - {r.axis}:
                yield name, "xyz"[axis], reshaped(features, i, step(axis))

        def same(e, r=r):
            return coaxial(r, e)

        if r.blind:
            floor = r.low_mm if r.blind == "low" else r.high_mm
            by = -STEP_MM if r.blind == "low" else STEP_MM
            deeper = carried(features, r.axis, floor[r.axis], by, same)
            planes = tuple(
                replace(p, at_mm=p.at_mm + by, corners=p.corners + step(r.axis, by))
                if closes(p, r) else p for p in features.planes
            )  # fmt: skip
            yield name, "depth", replace(deeper, planes=planes)
        levels = {(p.axis, round(p.at_mm, 5)) for p in features.planes}
        levels |= {(r.axis, round(c, 5)) for o in features.other_faces
                   if (c := o.centre[r.axis]) is not None}  # fmt: skip
        for end in (r.low_mm, r.high_mm):
            rim = any(same(e) and np.allclose(e.low_mm, end, atol=SAME_MM) for e in features.edges)
            if rim and (r.axis, round(end[r.axis], 5)) not in levels:
                yield name, "end", carried(features, r.axis, end[r.axis], STEP_MM, same)


def other_faces(features):
    """(feature, quantity, features): spheres larger and moved, other faces larger or tilted."""
    for i, o in enumerate(features.other_faces):

        def other(i=i, o=o, **changes):
            faces = list(features.other_faces)
            faces[i] = replace(o, **changes)
            return replace(features, other_faces=tuple(faces))

        name = f"{o.kind} {o.sizes[0]:.4g} at {o.point}"
        if o.kind in ("cone", "slant"):
            about = np.eye(3)[np.abs(o.normal).argmin()]
            normal = np.array(o.normal) + np.radians(TURN_DEG) * np.cross(about, o.normal)
            sizes = tuple(s + TURN_DEG for s in o.sizes)
            yield name, "angle", other(sizes=sizes, normal=tuple(normal))
            continue
        radius = min(o.sizes)
        grown = other(sizes=tuple(s * (radius + STEP_MM / 2) / radius for s in o.sizes))
        for axis, c in enumerate(o.centre):
            for sign in (-1, 1):
                if c is not None:
                    old = c + sign * radius
                    grown = with_box(grown, old, old + sign * STEP_MM / 2, axis)
        yield name, "diameter", grown
        for axis, c in enumerate(o.centre if o.kind in ("SØ", "SR") else ()):
            at = carried(other(centre=moved(o.centre, step(axis))), axis, c, STEP_MM)
            for sign in (-1, 1):
                at = with_box(at, c + sign * radius, c + sign * radius + STEP_MM, axis)
            yield name, "xyz"[axis], at


def numbers(part, design, solid, monkeypatch, features, projections):
    """All words with a number in the PDF as poppler reads it, apart from scale and sheet."""
    monkeypatch.setattr(drafting, "features_of", lambda _: features)
    monkeypatch.setattr(drafting, "project_views", lambda *_: projections)
    pdf = drafting.drawing(part, design, solid).pdf()
    text = subprocess.run(["pdftotext", "-", "-"], input=pdf, capture_output=True, check=True)
    words = re.findall(r"\S*\d\S*", text.stdout.decode())
    return sorted(word for word in words if not re.fullmatch(r"\d:\d|A[34]", word))


def untold(name, monkeypatch):
    """Count of pairs of feature and quantity; those that change no number; those without fault."""
    part, design = registry.find_part(name), load_design()
    solid, _ = build_part(part, design)
    features, callouts = features_of(solid), part.callouts(part.source(design))
    projections = drafting.project_views(solid, callouts)
    said = numbers(part, design, solid, monkeypatch, features, projections)
    changed = [*rounds(features), *other_faces(features)]
    changed += [(f, q, features_of(s)) for f, q, s in solids(solid) if len(s.Solids()) == 1]
    silent = [
        (f"{feature}: {quantity}", new)
        for feature, quantity, new in changed
        if numbers(part, design, solid, monkeypatch, new, projections) == said
    ]
    passing = [what for what, new in silent if not scheme(new, callouts).faults]
    return len(changed), [what for what, _ in silent], passing


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="pdftotext is not installed")
@pytest.mark.parametrize("name", CASES)
def test_each_quantity_is_in_the_text(name, monkeypatch):
    count, silent, passing = untold(name, monkeypatch)
    assert count > 2
    assert passing == []
    # Tangent flats and an ellipsoid are described in words, and a wrong one fails the row.
    assert all(re.match("slant|curve", what) for what in silent)


def test_unprinted_depth_gets_a_length(monkeypatch):
    cq = require()
    block = cq.Workplane().box(20, 20, 10, centered=(True, True, False))
    sunk = block.faces(">Z").workplane().center(4, 0).circle(2).cutBlind(-3).val()
    features = features_of(sunk)

    def along_z():
        return [length.value_mm for length in scheme(features, Callouts()).lengths
                if length.axis == 2]  # fmt: skip

    assert along_z() == [10.0]
    monkeypatch.setattr(schemes, "_opens_in_plane", lambda *_: False)
    assert along_z() == [10.0, 7.0]
