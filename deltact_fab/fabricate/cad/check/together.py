"""Pieces put together: the room that the sensor takes, what two pieces share, how screws grip, what
the mold holds with a frame in it, and the test bench.
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
from ..kernel import VOLUME_TOLERANCE, Box, bounding_box, require, shifted
from ..parts.camera import BOARD_KEYS
from ..parts.indenter import plate_half_mm
from ..parts.mold import centres_mm
from ..parts.on_stage import SIZE
from .built import BuiltDesign

SLACK_MM = 1e-5  # of the kernel's boxes
# Common volume that the kernel leaves between faces that only touch.
TOUCH_MM3 = 1e-3
THREADED = {"screw": "skin-frame", "camera-screw": "camera-holder"}
# A thread cut into resin strips before the screw breaks below twice its diameter.
ENGAGEMENT_D = 2.0
# The board hangs on two screws without load: one diameter holds it.
CAMERA_D = 1.0
GAP_MM = 1.0  # least, from what hangs from the stage to what stands on the table


def envelope(model: BuiltDesign) -> Iterator[Check]:
    """The box around all parts against design.envelope."""
    design = model.design
    boxes = np.array([piece_box(model, piece) for piece in _sensor_pieces(model)])
    size = boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)
    limit = (design.envelope.width_mm, design.envelope.length_mm, design.envelope.height_mm)
    status = graded(bool(np.all(size <= np.add(limit, SLACK_MM))))
    keys = ("camera.lens_height_mm", "mount.flange_width_mm", "mount.flange_height_mm")
    text, limit_text = f"{_format_lengths(*size)} mm", f"<= {_format_lengths(*limit)} mm"
    yield Check("envelope", "envelope", "assembly", text, limit_text, status, keys)


def _sensor_pieces(model: BuiltDesign) -> list[PlacedPart]:
    return places(model.design, [part for part in model.parts if part.group == "sensor"])


def _format_lengths(*lengths_mm: float) -> str:
    return " x ".join(f"{v:.2f}".rstrip("0").rstrip(".") for v in lengths_mm)


def interference(model: BuiltDesign) -> Iterator[Check]:
    """Common volume of each pair of parts: none, and of a screw in its pilot the thread alone."""
    sensor = _sensor_pieces(model)
    pairs = len(sensor) * (len(sensor) - 1) // 2
    clashes: list[tuple[float, str, str]] = []
    for first, second, mm3 in shared_volumes(model, sensor):
        threaded = any({s, holder} == {first, second} for s, holder in THREADED.items())
        if mm3 > TOUCH_MM3 and not threaded:
            text = f"{first} in {second}: {mm3:.3f} mm3"
            clashes.append((mm3, f"{first}, {second}", text))
    limit = f"<= {TOUCH_MM3:g} mm3 a pair"
    keys = ("camera.lens_diameter_mm", "camera.lens_height_mm", "mount.")
    for k, (_, pair, text) in enumerate(sorted(clashes, reverse=True)[:4]):
        yield Check(f"interference.{k}", "interference", pair, text, limit, "fail", keys)
    if not clashes:
        value = f"none in {pairs} pairs"
        yield Check("interference", "interference", "assembly", value, limit, "pass", keys)


def piece_box(model: BuiltDesign, place: PlacedPart) -> Box:
    """The box of a piece where it stands."""
    return shifted(model.box(place.part.name), place.shift_mm)


def shared_volumes(
    model: BuiltDesign, pieces: Sequence[PlacedPart], obstacles: Sequence[PlacedPart] | None = None
) -> Iterator[tuple[str, str, float]]:
    """Names of two parts and the volume in mm3 that their pieces share, where boxes meet.

    Pairs within `some`, or of one of `some` and one of `others`. Raises RunFailed as `common_mm3`
    does.
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
    """The length by which each kind of screw grips its holder, in diameters."""
    for screw, holder, times, key, rests_on in (
        ("screw", "skin-frame", ENGAGEMENT_D, "screw.engagement_mm", ()),
        ("camera-screw", "camera-holder", CAMERA_D, "holder.screw_length_mm", BOARD_KEYS),
    ):
        screws = places(model.design, [part for part in model.parts if part.name == screw])
        if not screws:
            continue
        # The shank is the thinnest face that is no hole.
        outer = [c for c in model.cylinders(screw) if not c.hole]
        shank = min(outer, key=lambda c: c.radius_mm)
        least_mm = min(_grip_mm(model, shank, place, holder) for place in screws)
        thread_mm = 2 * shank.radius_mm
        value = f"{least_mm:.2f} mm ({least_mm / thread_mm:.1f} d)"
        limit = f">= {times:g} d = {times * thread_mm:.2f} mm ({key}: more)"
        id, status = f"engagement.{screw}", graded(least_mm >= times * thread_mm - 1e-6)
        yield Check(id, "engagement", f"{screw}, {holder}", value, limit, status, rests_on)


def _grip_mm(model: BuiltDesign, shank: Round, place: PlacedPart, holder: str) -> float:
    """How far a screw stands in its pilot. Raises RunFailed where it has none."""
    x, y, z = place.shift_mm
    holes = [c for c in model.cylinders(holder) if c.hole]
    pilots = rounds_near(holes, x, y, model.design.post_mm / 4)
    if not pilots:
        raise RunFailed(f"{holder} has no hole at ({x:.2f}, {y:.2f})")
    pilot = min(pilots, key=lambda hole: hole.radius_mm)
    low = max(shank.low_mm[2] + z, pilot.low_mm[2])
    return max(min(shank.high_mm[2] + z, pilot.high_mm[2]) - low, 0.0)


def closure(model: BuiltDesign) -> Iterator[Check]:
    """V(cavity) + V(the frame's window in front of the ledge) = V(skin), by filling the mold."""

    def fill_cavities() -> tuple[float, list[float]]:
        fills_mm3 = [
            _fill_mm3(model, frame, centre_mm) for frame, centre_mm in _seated_frames(model)
        ]
        return float(model.solid("skin").Volume()), fills_mm3

    skin_mm3, volumes_mm3 = model.fact("held", ("mold", "skin-frame", "skin"), fill_cavities)
    worst = max(volumes_mm3, key=lambda v: abs(v - skin_mm3))
    value = f"{worst:.3f} mm3, the skin {skin_mm3:.3f} ({len(volumes_mm3)} cavities)"
    limit, parts = f"within {VOLUME_TOLERANCE:g} of the skin", "mold, skin-frame, skin"
    status = graded(abs(worst - skin_mm3) <= VOLUME_TOLERANCE * skin_mm3)
    yield Check("mold-closure", "mold volume closure", parts, value, limit, status)


def _seated_frames(model: BuiltDesign) -> list[tuple[Any, tuple[float, float]]]:
    """The frame, turned half about x, in each of the mold's seats."""
    cq = require()
    turned = model.solid("skin-frame").rotate(cq.Vector(), cq.Vector(1, 0, 0), 180)
    base_mm = model.design.mold.base_mm
    return [
        (turned.moved(cq.Location((x, y, base_mm))), (x, y)) for x, y in centres_mm(model.design)
    ]


def _fill_mm3(model: BuiltDesign, frame: Any, at_mm: tuple[float, float]) -> float:
    """What silicone takes when one cavity and the frame above it are filled to the ledge."""
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
    # The frame's pilot holes stay empty: silicone takes what hangs together with the cavity.
    front = bounding_box(frame)[0][2]
    free = block.cut(mold, frame).Solids()
    return float(sum(s.Volume() for s in free if bounding_box(s)[0][2] < front - 1e-3))


def bench(model: BuiltDesign) -> Iterator[Check]:
    """Stage plate and sensor, indenter, tool holder, adapter, force sensor, pressed together.

    The tip is as deep as the press that the design is made for (`plate.depth_mm`), where it shares
    room with the skin alone. What hangs may stand over any place of the face: it has to keep above
    everything that stands.
    """
    depth_mm = model.design.plate.depth_mm
    tips = [part for part in model.parts if part.indenter is not None]
    if not tips:
        value, limit = "no indenter is listed", "one indenter at least"
        yield Check("bench-clear", "bench clear", "bench", value, limit, "fail")
        return
    # All stems are alike: the widest back plate has the least room.
    widest = max(tips, key=lambda part: max(plate_half_mm(part.source(model.design))))
    standing, hanging = bench_places(model.design, widest, depth_mm)
    shares = [
        *shared_volumes(model, standing), *shared_volumes(model, hanging), *shared_volumes(model, hanging, standing),
    ]  # fmt: skip
    # Threads and the pressed gel share room on purpose; "interference" has the sensor's own pairs.
    sensor_names = {place.part.name for place in standing if place.part.group == "sensor"}
    clashes = sorted(
        ((mm3, f"{first} in {second}: {mm3:.3f} mm3") for first, second, mm3 in shares
         if mm3 > TOUCH_MM3 and not {first, second} <= sensor_names and {first, second} != {widest.name, "skin"}),
        reverse=True,
    )  # fmt: skip
    low = min(piece_box(model, piece)[0][2] for piece in standing)
    top = max(piece_box(model, piece)[1][2] for piece in standing)
    high = max(piece_box(model, piece)[1][2] for piece in hanging)
    value = f"none of {len(standing)} pieces on the table and {len(hanging)} on the stage"
    value = "; ".join(text for _, text in clashes[:4]) or value
    limit = f"<= {TOUCH_MM3:g} mm3 a pair, {depth_mm:g} mm deep (plate.depth_mm)"
    stack, status = f"bench, {widest.name}", graded(not clashes)
    yield Check("bench-clear", "bench clear", stack, value, limit, status, SIZE)
    free = {part.name: part.source(model.design).indenter.reach_mm for part in tips}
    gap, short = min((mm - depth_mm - top, name) for name, mm in free.items())
    value = (
        f"back plates {gap:.1f} mm or more above the face ({short}) at {depth_mm:g} mm; "
        f"{high - low:.1f} mm from the table to the force sensor's back"
    )
    limit = f">= {GAP_MM:g} mm anywhere on the face (plate.depth_mm)"
    stack, status = f"bench, {len(tips)} indenters", graded(gap >= GAP_MM)
    yield Check("bench-reach", "bench reach", stack, value, limit, status, SIZE)
