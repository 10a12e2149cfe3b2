"""The test bench put together: sensor and stage plate, and what hangs over them."""

from __future__ import annotations

from collections.abc import Iterator

from ..assembly import on_bench
from ..parts.indenter import plate_half_mm
from ..parts.nano17_adapter import SIZE
from .built import BuiltDesign
from .pairs import box_of, shared
from .row import Row
from .space import TOUCH_MM3

CLEAR, REACH = "bench clear", "bench reach"
GAP_MM = 1.0  # least, from what hangs from the stage to what stands on the table


def rows(built: BuiltDesign) -> Iterator[Row]:
    """Stage plate and sensor, indenter, tool holder, adapter, force sensor, pressed together.

    The tip is as deep as the press that the design is made for (`plate.depth_mm`), where it shares
    room with the skin alone. What hangs may stand over any place of the face: it has to keep above
    everything that stands.
    """
    depth_mm = built.design.plate.depth_mm
    tips = [part for part in built.parts if part.indenter is not None]
    if not tips:
        yield Row(CLEAR, "bench", "no indenter is listed", "one indenter at least", False)
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
    yield Row(
        CLEAR,
        f"bench, {widest.name}",
        "; ".join(text for _, text in clashes[:4]) or found,
        f"<= {TOUCH_MM3:g} mm3 a pair, {depth_mm:g} mm deep (plate.depth_mm)",
        not clashes,
        SIZE,
    )
    free = {part.name: part.source(built.design).plate_z_mm for part in tips}
    gap, short = min((mm - depth_mm - top, name) for name, mm in free.items())
    yield Row(
        REACH,
        f"bench, {len(tips)} indenters",
        f"back plates {gap:.1f} mm or more above the face ({short}) at {depth_mm:g} mm; "
        f"{high - low:.1f} mm from the table to the force sensor's back",
        f">= {GAP_MM:g} mm anywhere on the face (plate.depth_mm)",
        gap >= GAP_MM,
        SIZE,
    )
