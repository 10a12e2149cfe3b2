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

from ..assembly import PlacedPart, common_mm3, meet, on_bench, places
from ..features import Round, near
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


def envelope(built: BuiltDesign) -> Iterator[Check]:
    """The box around all parts against design.envelope."""
    design = built.design
    boxes = np.array([box_of(built, piece) for piece in _sensor(built)])
    size = boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)
    limit = (design.envelope.width_mm, design.envelope.length_mm, design.envelope.height_mm)
    status = graded(bool(np.all(size <= np.add(limit, SLACK_MM))))
    keys = ("camera.lens_height_mm", "mount.flange_width_mm", "mount.flange_height_mm")
    text, most = f"{_by(*size)} mm", f"<= {_by(*limit)} mm"
    yield Check("envelope", "envelope", "assembly", text, most, status, keys)


def _sensor(built: BuiltDesign) -> list[PlacedPart]:
    return places(built.design, [part for part in built.parts if part.group == "sensor"])


def _by(*lengths_mm: float) -> str:
    return " x ".join(f"{v:.2f}".rstrip("0").rstrip(".") for v in lengths_mm)


def interference(built: BuiltDesign) -> Iterator[Check]:
    """Common volume of each pair of parts: none, and of a screw in its pilot the thread alone."""
    sensor = _sensor(built)
    pairs = len(sensor) * (len(sensor) - 1) // 2
    clashes: list[tuple[float, str, str]] = []
    for first, second, mm3 in shared(built, sensor):
        threaded = any({s, holder} == {first, second} for s, holder in THREADED.items())
        if mm3 > TOUCH_MM3 and not threaded:
            text = f"{first} in {second}: {mm3:.3f} mm3"
            clashes.append((mm3, f"{first}, {second}", text))
    limit = f"<= {TOUCH_MM3:g} mm3 a pair"
    keys = ("camera.lens_diameter_mm", "camera.lens_height_mm", "mount.")
    for k, (_, pair, text) in enumerate(sorted(clashes, reverse=True)[:4]):
        yield Check(f"interference.{k}", "interference", pair, text, limit, "fail", keys)
    if not clashes:
        found = f"none in {pairs} pairs"
        yield Check("interference", "interference", "assembly", found, limit, "pass", keys)


def box_of(built: BuiltDesign, place: PlacedPart) -> Box:
    """The box of a piece where it stands."""
    return shifted(built.box(place.part.name), place.shift_mm)


def shared(
    built: BuiltDesign, some: Sequence[PlacedPart], others: Sequence[PlacedPart] | None = None
) -> Iterator[tuple[str, str, float]]:
    """Names of two parts and the volume in mm3 that their pieces share, where boxes meet.

    Pairs within `some`, or of one of `some` and one of `others`. Raises RunFailed as `common_mm3`
    does.
    """
    boxes = {place: box_of(built, place) for place in (*some, *(others or ()))}
    for a, b in combinations(some, 2) if others is None else product(some, others):
        if meet(boxes[a], boxes[b]):
            names = a.part.name, b.part.name
            apart = [round(q - p, 9) for p, q in zip(a.shift_mm, b.shift_mm, strict=True)]
            what = f"common volume {apart}"
            first, second = sorted(names)
            yield first, second, built.fact(what, names, partial(_common_mm3, built, a, b))


def _common_mm3(built: BuiltDesign, *pair: PlacedPart) -> float:
    one, other = (place.put(built.solid(place.part.name)) for place in pair)
    return common_mm3(one, other)


def engagement(built: BuiltDesign) -> Iterator[Check]:
    """The length by which each kind of screw grips its holder, in diameters."""
    for screw, holder, times, key, rests_on in (
        ("screw", "skin-frame", ENGAGEMENT_D, "screw.engagement_mm", ()),
        ("camera-screw", "camera-holder", CAMERA_D, "holder.screw_length_mm", BOARD_KEYS),
    ):
        screws = places(built.design, [part for part in built.parts if part.name == screw])
        if not screws:
            continue
        # The shank is the thinnest face that is no hole.
        outer = [c for c in built.cylinders(screw) if not c.hole]
        shank = min(outer, key=lambda c: c.radius_mm)
        least_mm = min(_grip_mm(built, shank, place, holder) for place in screws)
        thread_mm = 2 * shank.radius_mm
        found = f"{least_mm:.2f} mm ({least_mm / thread_mm:.1f} d)"
        limit = f">= {times:g} d = {times * thread_mm:.2f} mm ({key}: more)"
        id, status = f"engagement.{screw}", graded(least_mm >= times * thread_mm - 1e-6)
        yield Check(id, "engagement", f"{screw}, {holder}", found, limit, status, rests_on)


def _grip_mm(built: BuiltDesign, shank: Round, place: PlacedPart, holder: str) -> float:
    """How far a screw stands in its pilot. Raises RunFailed where it has none."""
    x, y, z = place.shift_mm
    holes = [c for c in built.cylinders(holder) if c.hole]
    pilots = near(holes, x, y, built.design.post_mm / 4)
    if not pilots:
        raise RunFailed(f"{holder} has no hole at ({x:.2f}, {y:.2f})")
    pilot = min(pilots, key=lambda hole: hole.radius_mm)
    low = max(shank.low_mm[2] + z, pilot.low_mm[2])
    return max(min(shank.high_mm[2] + z, pilot.high_mm[2]) - low, 0.0)


def closure(built: BuiltDesign) -> Iterator[Check]:
    """V(cavity) + V(the frame's window in front of the ledge) = V(skin), by filling the mold."""

    def filled() -> tuple[float, list[float]]:
        held = [_held_mm3(built, frame, at) for frame, at in _seated(built)]
        return float(built.solid("skin").Volume()), held

    skin_mm3, held = built.fact("held", ("mold", "skin-frame", "skin"), filled)
    worst = max(held, key=lambda v: abs(v - skin_mm3))
    found = f"{worst:.3f} mm3, the skin {skin_mm3:.3f} ({len(held)} cavities)"
    limit, parts = f"within {VOLUME_TOLERANCE:g} of the skin", "mold, skin-frame, skin"
    status = graded(abs(worst - skin_mm3) <= VOLUME_TOLERANCE * skin_mm3)
    yield Check("mold-closure", "mold volume closure", parts, found, limit, status)


def _seated(built: BuiltDesign) -> list[tuple[Any, tuple[float, float]]]:
    """The frame, turned half about x, in each of the mold's seats."""
    cq = require()
    turned = built.solid("skin-frame").rotate(cq.Vector(), cq.Vector(1, 0, 0), 180)
    base_mm = built.design.mold.base_mm
    return [
        (turned.moved(cq.Location((x, y, base_mm))), (x, y)) for x, y in centres_mm(built.design)
    ]


def _held_mm3(built: BuiltDesign, frame: Any, at_mm: tuple[float, float]) -> float:
    """What silicone takes when one cavity and the frame above it are filled to the ledge."""
    cq = require()
    design, mold = built.design, built.solid("mold")
    low, high = np.array(built.box("skin"))
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


def bench(built: BuiltDesign) -> Iterator[Check]:
    """Stage plate and sensor, indenter, tool holder, adapter, force sensor, pressed together.

    The tip is as deep as the press that the design is made for (`plate.depth_mm`), where it shares
    room with the skin alone. What hangs may stand over any place of the face: it has to keep above
    everything that stands.
    """
    depth_mm = built.design.plate.depth_mm
    tips = [part for part in built.parts if part.indenter is not None]
    if not tips:
        found, limit = "no indenter is listed", "one indenter at least"
        yield Check("bench-clear", "bench clear", "bench", found, limit, "fail")
        return
    # All stems are alike: the widest back plate has the least room.
    widest = max(tips, key=lambda part: max(plate_half_mm(part.source(built.design))))
    standing, hanging = on_bench(built.design, widest, depth_mm)
    shares = [
        *shared(built, standing), *shared(built, hanging), *shared(built, hanging, standing),
    ]  # fmt: skip
    # Threads and the pressed gel share room on purpose; "interference" has the sensor's own pairs.
    own = {place.part.name for place in standing if place.part.group == "sensor"}
    clashes = sorted(
        ((mm3, f"{one} in {other}: {mm3:.3f} mm3") for one, other, mm3 in shares
         if mm3 > TOUCH_MM3 and not {one, other} <= own and {one, other} != {widest.name, "skin"}),
        reverse=True,
    )  # fmt: skip
    low = min(box_of(built, piece)[0][2] for piece in standing)
    top = max(box_of(built, piece)[1][2] for piece in standing)
    high = max(box_of(built, piece)[1][2] for piece in hanging)
    found = f"none of {len(standing)} pieces on the table and {len(hanging)} on the stage"
    found = "; ".join(text for _, text in clashes[:4]) or found
    limit = f"<= {TOUCH_MM3:g} mm3 a pair, {depth_mm:g} mm deep (plate.depth_mm)"
    stack, status = f"bench, {widest.name}", graded(not clashes)
    yield Check("bench-clear", "bench clear", stack, found, limit, status, SIZE)
    free = {part.name: part.source(built.design).indenter.reach_mm for part in tips}
    gap, short = min((mm - depth_mm - top, name) for name, mm in free.items())
    found = (
        f"back plates {gap:.1f} mm or more above the face ({short}) at {depth_mm:g} mm; "
        f"{high - low:.1f} mm from the table to the force sensor's back"
    )
    limit = f">= {GAP_MM:g} mm anywhere on the face (plate.depth_mm)"
    stack, status = f"bench, {len(tips)} indenters", graded(gap >= GAP_MM)
    yield Check("bench-reach", "bench reach", stack, found, limit, status, SIZE)
