"""Checks of assembled pieces: envelope, interference, screw engagement, volume of the closed mold,
and the test bench.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import combinations, product
from typing import Any

import numpy as np

from deltact_fab.common import Check, RunFailed, graded

from ..assembly import PlacedPart, bench_places, boxes_overlap, common_mm3, places
from ..features import Round, rounds_near
from ..kernel import VOLUME_TOLERANCE, Extent, bounding_box, require, shifted
from ..parts.camera import BOARD_KEYS
from ..parts.indenter import plate_half_mm
from ..parts.mold import centres_mm
from ..parts.on_stage import SENSOR_SIZE_KEYS
from .built import BuiltDesign

BOX_SLACK_MM = 1e-5  # by hand: above the rounding of the kernel's boxes
# By hand: the kernel's common volume of touching faces is below; larger hides a clash.
TOUCH_MM3 = 1e-3
THREADED_PAIRS = {"screw": "skin-frame", "camera-screw": "camera-holder"}
# By hand, in diameters: with less, a thread cut into resin strips before the screw breaks.
ENGAGEMENT_D = 2.0
# By hand, in diameters: enough for the camera's board, which carries no load.
CAMERA_ENGAGEMENT_D = 1.0
STAGE_GAP_MM = 1.0  # by hand, minimum between stage and table pieces: less risks a collision


def envelope(model: BuiltDesign) -> Iterator[Check]:
    """Compare the bounding box of all parts with design.envelope."""
    design = model.design
    boxes = np.array([piece_box(model, piece) for piece in _sensor_pieces(model)])
    size = boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)
    limit = (design.envelope.width_mm, design.envelope.length_mm, design.envelope.height_mm)
    status = graded(bool(np.all(size <= np.add(limit, BOX_SLACK_MM))))
    keys = ("camera.lens_height_mm", "mount.flange_width_mm", "mount.flange_height_mm")
    text, limit_text = _size_text(*size), f"<= {_size_text(*limit)}"
    yield Check("envelope", "envelope", "assembly", text, limit_text, status, keys)


def _sensor_pieces(model: BuiltDesign) -> list[PlacedPart]:
    return places(model.design, [part for part in model.parts if part.group == "sensor"])


def _size_text(*lengths_mm: float) -> str:
    return " x ".join(f"{v:.2f}".rstrip("0").rstrip(".") for v in lengths_mm) + " mm"


def interference(model: BuiltDesign) -> Iterator[Check]:
    """Check the common volume of each pair of parts: none, except a screw's thread in its pilot."""
    sensor = _sensor_pieces(model)
    pairs = len(sensor) * (len(sensor) - 1) // 2
    clashes: list[tuple[float, str, str]] = []
    for first, second, mm3 in shared_volumes(model, sensor):
        threaded = any({s, holder} == {first, second} for s, holder in THREADED_PAIRS.items())
        if mm3 > TOUCH_MM3 and not threaded:
            text = f"{first} in {second}: {mm3:.3f} mm3"
            clashes.append((mm3, f"{first}, {second}", text))
    limit = f"<= {TOUCH_MM3:g} mm3 per pair"
    keys = ("camera.lens_diameter_mm", "camera.lens_height_mm", "mount.")
    for k, (_, pair, text) in enumerate(sorted(clashes, reverse=True)[:4]):
        yield Check(f"interference.{k}", "interference", pair, text, limit, "fail", keys)
    if not clashes:
        value = f"none in {pairs} pairs"
        yield Check("interference", "interference", "assembly", value, limit, "pass", keys)


def piece_box(model: BuiltDesign, place: PlacedPart) -> Extent:
    """Return the bounding box of a piece at its position."""
    return shifted(model.box(place.part.name), place.shift_mm)


def shared_volumes(
    model: BuiltDesign, pieces: Sequence[PlacedPart], obstacles: Sequence[PlacedPart] | None = None
) -> Iterator[tuple[str, str, float]]:
    """Yield names of two parts and the volume in mm3 common to their pieces, if boxes overlap.

    Pairs within `pieces`, or of a piece and an obstacle. Raises RunFailed as `common_mm3`.
    """
    boxes = {place: piece_box(model, place) for place in (*pieces, *(obstacles or ()))}
    for a, b in combinations(pieces, 2) if obstacles is None else product(pieces, obstacles):
        if boxes_overlap(boxes[a], boxes[b]):
            names = a.part.name, b.part.name
            offset = [round(q - p, 9) for p, q in zip(a.shift_mm, b.shift_mm, strict=True)]
            kind = f"common volume {offset}"
            first, second = sorted(names)
            yield first, second, model.fact(kind, names, partial(_common_mm3, model, a, b))


def _common_mm3(model: BuiltDesign, *pair: PlacedPart) -> float:
    first, second = (place.with_solid(model.solid(place.part.name)) for place in pair)
    return common_mm3(first, second)


def engagement(model: BuiltDesign) -> Iterator[Check]:
    """Check the thread engagement of each kind of screw, in diameters."""
    for screw, holder, times, key, rests_on in (
        ("screw", "skin-frame", ENGAGEMENT_D, "screw.engagement_mm", ()),
        ("camera-screw", "camera-holder", CAMERA_ENGAGEMENT_D, "holder.screw_length_mm",
         BOARD_KEYS),
    ):  # fmt: skip
        screws = places(model.design, [part for part in model.parts if part.name == screw])
        if not screws:
            continue
        # The shank is the thinnest face that is no hole.
        outer = [c for c in model.cylinders(screw) if not c.hole]
        shank = min(outer, key=lambda c: c.radius_mm)
        least_mm = min(_grip_mm(model, shank, place, holder) for place in screws)
        thread_mm = 2 * shank.radius_mm
        value = f"{least_mm:.2f} mm ({least_mm / thread_mm:.1f} d)"
        limit = f">= {times:g} d = {times * thread_mm:.2f} mm (increase {key})"
        id, status = f"engagement.{screw}", graded(least_mm >= times * thread_mm - 1e-6)
        yield Check(id, "engagement", f"{screw}, {holder}", value, limit, status, rests_on)


def _grip_mm(model: BuiltDesign, shank: Round, place: PlacedPart, holder: str) -> float:
    """Engaged length of a screw in its pilot. Raises RunFailed if there is no pilot."""
    x, y, z = place.shift_mm
    holes = [c for c in model.cylinders(holder) if c.hole]
    pilots = rounds_near(holes, x, y, model.design.post_mm / 4)
    if not pilots:
        raise RunFailed(f"{holder} has no hole at ({x:.2f}, {y:.2f})")
    pilot = min(pilots, key=lambda hole: hole.radius_mm)
    low = max(shank.low_mm[2] + z, pilot.low_mm[2])
    return max(min(shank.high_mm[2] + z, pilot.high_mm[2]) - low, 0.0)


def closure(model: BuiltDesign) -> Iterator[Check]:
    """Check V(cavity) + V(frame's window in front of the ledge) = V(skin) by filling the mold."""

    def fill_cavities() -> tuple[float, list[float]]:
        fills_mm3 = [_fill_mm3(model, *seated) for seated in _seated_frames(model)]
        return float(model.solid("skin").Volume()), fills_mm3

    skin_mm3, volumes_mm3 = model.fact("held", ("mold", "skin-frame", "skin"), fill_cavities)
    worst = max(volumes_mm3, key=lambda v: abs(v - skin_mm3))
    value = f"{worst:.3f} mm3 filled, skin {skin_mm3:.3f} ({len(volumes_mm3)} cavities)"
    limit, parts = f"within {VOLUME_TOLERANCE:g} of the skin", "mold, skin-frame, skin"
    status = graded(abs(worst - skin_mm3) <= VOLUME_TOLERANCE * skin_mm3)
    yield Check("mold-closure", "mold volume closure", parts, value, limit, status)


def _seated_frames(model: BuiltDesign) -> list[tuple[Any, tuple[float, float]]]:
    """Return the frame, turned by 180° about x, in each seat of the mold, with the centre."""
    cq = require()
    turned = model.solid("skin-frame").rotate(cq.Vector(), cq.Vector(1, 0, 0), 180)
    base_mm = model.design.mold.base_mm
    return [
        (turned.moved(cq.Location((x, y, base_mm))), (x, y)) for x, y in centres_mm(model.design)
    ]


def _fill_mm3(model: BuiltDesign, frame: Any, at_mm: tuple[float, float]) -> float:
    """Volume of silicone in one cavity and the frame above it, filled to the ledge."""
    cq = require()
    design, mold = model.design, model.solid("mold")
    low, high = np.array(model.box("skin"))
    # The block ends inside mold and frame: beside the frame is the play of its seat.
    x = high[0] + design.frame.wall_x_mm / 2
    y = high[1] + design.frame.wall_y_mm / 2
    bottom = design.mold.base_mm / 2
    top = design.mold.base_mm + (high[2] - low[2])
    corner = cq.Vector(at_mm[0] - x, at_mm[1] - y, bottom)
    block = cq.Solid.makeBox(2 * x, 2 * y, top - bottom, corner)
    # The frame's pilot holes stay empty: silicone fills the volume connected to the cavity.
    front = bounding_box(frame)[0][2]
    free = block.cut(mold, frame).Solids()
    return float(sum(s.Volume() for s in free if bounding_box(s)[0][2] < front - 1e-3))


def bench(model: BuiltDesign) -> Iterator[Check]:
    """Check clearances of stage plate, sensor, indenter, tool holder, adapter and force sensor.

    The tip is at the design's press depth (`plate.depth_mm`), where it overlaps the skin alone.
    The stage may be over any point of the face: its pieces stay above all pieces on the table.
    """
    depth_mm = model.design.plate.depth_mm
    tips = [part for part in model.parts if part.indenter is not None]
    if not tips:
        value, limit = "no indenter listed", ">= 1 indenter"
        yield Check("bench-clear", "bench clear", "bench", value, limit, "fail")
        return
    # All stems are alike: the widest back plate has the least room.
    widest = max(tips, key=lambda part: max(plate_half_mm(part.source(model.design))))
    standing, hanging = bench_places(model.design, widest, depth_mm)
    shares = [
        *shared_volumes(model, standing), *shared_volumes(model, hanging),
        *shared_volumes(model, hanging, standing),
    ]  # fmt: skip
    # Threads and the pressed gel overlap on purpose; "interference" covers pairs of the sensor.
    in_sensor = {place.part.name for place in standing if place.part.group == "sensor"}
    clashes = sorted(
        ((mm3, f"{first} in {second}: {mm3:.3f} mm3") for first, second, mm3 in shares
         if mm3 > TOUCH_MM3 and not {first, second} <= in_sensor
         and {first, second} != {widest.name, "skin"}), reverse=True,
    )  # fmt: skip
    low = min(piece_box(model, piece)[0][2] for piece in standing)
    top = max(piece_box(model, piece)[1][2] for piece in standing)
    high = max(piece_box(model, piece)[1][2] for piece in hanging)
    value = f"no overlap: {len(standing)} pieces on the table, {len(hanging)} on the stage"
    value = "; ".join(text for _, text in clashes[:4]) or value
    limit = f"<= {TOUCH_MM3:g} mm3 per pair, at {depth_mm:g} mm depth (plate.depth_mm)"
    stack, status = f"bench, {widest.name}", graded(not clashes)
    yield Check("bench-clear", "bench clear", stack, value, limit, status, SENSOR_SIZE_KEYS)
    free = {part.name: part.source(model.design).indenter.reach_mm for part in tips}
    gap, short = min((mm - depth_mm - top, name) for name, mm in free.items())
    value = (
        f"back plates >= {gap:.1f} mm above the face ({short}) at {depth_mm:g} mm depth; "
        f"{high - low:.1f} mm from the table to the force sensor's back"
    )
    limit = f">= {STAGE_GAP_MM:g} mm anywhere on the face (plate.depth_mm)"
    stack, status = f"bench, {len(tips)} indenters", graded(gap >= STAGE_GAP_MM)
    yield Check("bench-reach", "bench reach", stack, value, limit, status, SENSOR_SIZE_KEYS)
