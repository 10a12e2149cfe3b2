"""Fit of a protocol to another design: positions, indenters, depths and drags."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from typing import Any

from deltact_fab.bench import Protocol
from deltact_fab.common import InputError, Point2, validate
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
    skin, thick_mm = target.skin, target.skin.thickness_mm
    sides = [b / a for a, b in zip(design.skin.opening_half_mm, skin.opening_half_mm, strict=True)]
    drag, depth = min(*sides, 1.0), min(thick_mm / design.skin.thickness_mm, 1.0)
    if protocol.stops_mm:
        deepest_mm = thick_mm - protocol.specimen.depth_margin_mm
        depth = min(depth, deepest_mm / protocol.stops_mm[-1])
    reach_mm: dict[str, list[float]] = {}  # of the drags, by indenter
    for press in protocol.list_presses():
        ends = [press.reach_mm(d) for d in press.depths_mm] or [(0.0, 0.0)]
        largest = [max(side) for side in zip(*ends, strict=True)]
        earlier = reach_mm.get(press.indenter, largest)
        reach_mm[press.indenter] = [max(pair) for pair in zip(earlier, largest, strict=True)]
    while True:
        scaled_mm = {n: [drag * mm for mm in reach] for n, reach in reach_mm.items()}
        try:
            names = dict(_smaller_indenters(scaled_mm, skin.opening_half_mm))
            break
        except InputError:
            drag *= DRAG_REDUCTION
            if drag < MIN_DRAG_SHARE:
                raise
    for press in protocol.list_presses():
        half_mm = parse_indenter(names[press.indenter]).footprint_half_mm
        for k, x_mm in enumerate(press.at_mm):
            room_mm = skin.opening_half_mm[k] - half_mm[k] - scaled_mm[press.indenter][k]
            sides[k] = min(sides[k], room_mm / abs(x_mm)) if x_mm else sides[k]
    lines = [f"{a} becomes {b}" for a, b in names.items() if a != b]
    across = [any(at_mm) for at_mm in zip(*protocol.places_mm, strict=True)]
    factors = {
        "positions along x": sides[0] if across[0] else 1.0,
        "positions along y": sides[1] if across[1] else 1.0,
        "depths": depth if protocol.stops_mm else 1.0,
        "drags": drag if any(map(any, reach_mm.values())) else 1.0,
    }
    lines += [f"{key} times {factor:.3g}" for key, factor in factors.items() if factor != 1]
    return _scaled(settings, names, (sides[0], sides[1]), depth, drag), lines


def _smaller_indenters(
    reach_mm: dict[str, list[float]], opening_mm: Point2
) -> Iterator[tuple[str, str]]:
    """Yield each indenter with itself, or the largest smaller one that fits and is not in use."""
    taken = set(reach_mm)
    for name in sorted(reach_mm, key=lambda n: max(parse_indenter(n).footprint_half_mm)):
        indenter = parse_indenter(name)
        kind, size_mm, fitting = name.partition(":")[0], 2 * max(indenter.footprint_half_mm), name
        while any(
            half + reach > (1 - MIN_SPREAD_SHARE) * opening
            for half, reach, opening in zip(
                parse_indenter(fitting).footprint_half_mm, reach_mm[name], opening_mm, strict=True
            )
        ) or (fitting != name and fitting in taken):
            size_mm = SIZE_STEP_MM * (math.ceil(size_mm / SIZE_STEP_MM) - 1)
            fitting = f"{kind}:{size_mm:g}"
            try:
                parse_indenter(fitting)
            except InputError as error:
                width_mm, length_mm = (2 * half for half in opening_mm)
                raise InputError(
                    f"{name}: no size of it suits a face of {width_mm:g} x {length_mm:g} mm with "
                    f"these drags; remove it from the protocol"
                ) from error
        taken.add(fitting)
        yield name, fitting


def _scaled(
    settings: dict[str, Any], names: dict[str, str], sides: Point2, depth: float, drag: float
) -> dict[str, Any]:
    """Settings with other indenters, and with all lengths times a factor, shortened to 0.01 mm."""

    def shorten(value: Any, factor: float) -> Any:
        return math.copysign(math.floor(abs(value) * factor * 100 + 1e-6) / 100, value)

    def place(at_mm: list[Any]) -> list[Any]:
        return [x if f == 1 else shorten(x, f) for x, f in zip(at_mm, sides, strict=True)]

    fitted = copy.deepcopy(settings)
    if "indenters" in fitted:
        fitted["indenters"] = [names[parse_indenter(n).name] for n in fitted["indenters"]]
    if "positions_mm" in fitted:
        fitted["positions_mm"] = [place(at_mm) for at_mm in fitted["positions_mm"]]
    for entry in fitted.get("press", ()):
        entry["indenter"] = names[parse_indenter(entry["indenter"]).name]
    factors = {
        "x": sides[0], "y": sides[1], "x_mm": sides[0], "y_mm": sides[1], "depth_mm": depth,
        "depths_mm": depth, "amplitude_mm": drag, "amplitude_of_depth": min(drag / depth, 1.0),
        "shear_x_mm": drag, "shear_y_mm": drag,
    }  # fmt: skip
    tables = [fitted, *(fitted.get(key, {}) for key in ("grid", "shear", "reference"))]
    for table in [*tables, *fitted.get("press", ())]:
        if "at_mm" in table:
            table["at_mm"] = place(table["at_mm"])
        for key in factors.keys() & table.keys():
            value, factor = table[key], factors[key]
            if factor != 1:
                several = isinstance(value, list)
                values = [shorten(v, factor) for v in (value if several else [value])]
                table[key] = values if several else values[0]
    return fitted
