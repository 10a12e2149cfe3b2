"""Fit of a protocol to another design: positions, indenters, depths and drags."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from deltact_fab.bench import Protocol
from deltact_fab.common import Array, InputError, validate
from deltact_fab.sensor import SensorDimensions, parse_indenter

MIN_SPREAD_SHARE = 0.25  # by hand: of half a side, left for positions of the largest indenter
DRAG_REDUCTION, MIN_DRAG_SHARE = 0.9, 0.1  # by hand: steps of the search, and its end
SIZE_STEP_MM = 0.5  # by hand: of a smaller indenter; also the smallest sphere


def fit_settings(
    settings: dict[str, Any], design: SensorDimensions, target: SensorDimensions
) -> tuple[dict[str, Any], list[str]]:
    """Fit the settings of a protocol for one design to another; with a line for each change.

    Positions follow the sides of the face; depths and drags get smaller with thickness and sides,
    but never larger. An indenter becomes smaller only if its contact would leave less than
    MIN_SPREAD_SHARE of half a side; drags do where it cannot. Then all positions are drawn in until
    every contact is on the face. Raises InputError if an indenter cannot be made small enough.
    """
    protocol = validate(Protocol, settings, str(settings.get("name")))
    presses, opening_mm = protocol.list_presses(), np.array(target.skin.opening_half_mm)
    sides = (opening_mm / design.skin.opening_half_mm).tolist()
    drag, thick_mm = min(*sides, 1.0), target.skin.thickness_mm
    depth = min(thick_mm / design.skin.thickness_mm, 1.0)
    if protocol.stops_mm:
        deepest_mm = thick_mm - protocol.specimen.depth_margin_mm
        depth = min(depth, deepest_mm / protocol.stops_mm[-1])
    drags_mm: dict[str, Any] = dict.fromkeys(
        protocol.tips, np.zeros(2)
    )  # largest ones along x and y
    for press in presses:
        ends_mm = [drags_mm[press.indenter], *map(press.reach_mm, press.depths_mm)]
        drags_mm[press.indenter] = np.max(ends_mm, axis=0)
    while True:
        reach_mm = {tip: drag * mm for tip, mm in drags_mm.items()}
        try:
            names = dict(_smaller_indenters(reach_mm, opening_mm))
            break
        except InputError:
            drag *= DRAG_REDUCTION
            if drag < MIN_DRAG_SHARE:
                raise
    for press in presses:
        half_mm = parse_indenter(names[press.indenter]).footprint_half_mm
        room_mm = opening_mm - half_mm - reach_mm[press.indenter]
        for k, x_mm in enumerate(press.at_mm):
            if x_mm:
                sides[k] = min(sides[k], float(room_mm[k]) / abs(x_mm))
    factors = {
        "positions along x": sides[0] if any(x for x, _ in protocol.places_mm) else 1.0,
        "positions along y": sides[1] if any(y for _, y in protocol.places_mm) else 1.0,
        "depths": depth if protocol.stops_mm else 1.0,
        "drags": drag if any(map(np.any, drags_mm.values())) else 1.0,
    }
    lines = [f"{a} becomes {b}" for a, b in names.items() if a != b]
    lines += [f"{key} times {factor:.3g}" for key, factor in factors.items() if factor != 1]
    of_key = {
        **dict.fromkeys(("x", "x_mm"), sides[0]), **dict.fromkeys(("y", "y_mm"), sides[1]),
        **dict.fromkeys(("depth_mm", "depths_mm"), depth),
        **dict.fromkeys(("amplitude_mm", "shear_x_mm", "shear_y_mm"), drag),
        "amplitude_of_depth": min(drag / depth, 1.0),
    }  # fmt: skip

    def fitted(key: str, value: Any) -> Any:
        """Other indenters, and lengths times a factor, shortened to 0.01 mm."""
        if isinstance(value, dict):
            return {name: fitted(name, inner) for name, inner in value.items()}
        if key == "at_mm":
            return [fitted(axis, mm) for axis, mm in zip("xy", value, strict=True)]
        if isinstance(value, list):
            return [fitted("at_mm" if key == "positions_mm" else key, inner) for inner in value]
        if key in ("indenter", "indenters"):
            return names[parse_indenter(value).name]
        if (factor := of_key.get(key, 1.0)) == 1:
            return value
        return math.copysign(math.floor(abs(value) * factor * 100 + 1e-6) / 100, value)

    return fitted("", settings), lines


def _smaller_indenters(reach_mm: dict[str, Array], opening_mm: Array) -> Iterator[tuple[str, str]]:
    """Yield each indenter with itself, or the largest smaller one that fits and is not in use."""
    in_use = set(reach_mm)
    sizes_mm = {name: 2 * max(parse_indenter(name).footprint_half_mm) for name in reach_mm}
    for name in sorted(sizes_mm, key=sizes_mm.__getitem__):
        steps = range(math.ceil(sizes_mm[name] / SIZE_STEP_MM) - 1, -1, -1)
        smaller = (f"{name.partition(':')[0]}:{SIZE_STEP_MM * n:g}" for n in steps)
        unused = (candidate for candidate in smaller if candidate not in in_use)
        room_mm = (1 - MIN_SPREAD_SHARE) * opening_mm
        try:
            fitting = next(
                candidate for candidate in itertools.chain([name], unused)
                if np.all(parse_indenter(candidate).footprint_half_mm + reach_mm[name] <= room_mm)
            )  # fmt: skip
        except InputError as error:
            width_mm, length_mm = 2 * opening_mm
            raise InputError(
                f"{name}: no size of it suits a face of {width_mm:g} x {length_mm:g} mm with "
                f"these drags; remove it from the protocol"
            ) from error
        in_use.add(fitting)
        yield name, fitting
