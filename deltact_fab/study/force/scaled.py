"""A calibration thinned to a share of its points, with all its indenters and the range of each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from ...errors import InputError
from ...protocols.plan import Protocol, expand

FEWEST = 2
"""Places and depths that are kept where there are so many: one of each can be left out."""
ABOVE = 1.25
"""Times the points asked for, from which on the shear stops of a depth are thinned too."""
_CROSS = {"grid": False, "points_per_side": 1}

Place = tuple[float, float]


class _Thinned(NamedTuple):
    points: int
    places: int
    depths: int
    cross: bool


def points_of(protocol: Protocol) -> int:
    """Settled points of a protocol."""
    return sum(step.settled for step in expand(protocol))


def scaled(protocol: Protocol, scale: float) -> Protocol:
    """The protocol with about scale x its points, scale in (0, 1].

    All indenters stay. Of places and of depths two are left at least, of depths the first and the
    last, and of places one of each set of mirror images before a second: what is left out in a
    cross-validation must be a place never seen. The stops of shear stay, as far out as they are,
    unless two places and two depths give over ABOVE x the points asked for; then a grid becomes its
    cross. What that comes to is the fewest points there are. Raises InputError for another scale.
    """
    if not 0 < scale <= 1:
        raise InputError(f"--scale: {scale:g}; expected above 0 and at most 1")
    wanted = scale * points_of(protocol)
    kept = _closest(protocol, wanted, cross=False)
    if kept.points > ABOVE * wanted and protocol.shear is not None and protocol.shear.grid:
        kept = _closest(protocol, wanted, cross=True)
    places = sorted(spread(protocol.positions_mm)[: kept.places])
    last = len(protocol.depths_mm) - 1
    steps = max(kept.depths - 1, 1)
    changed = {
        "positions_mm": [protocol.positions_mm[n] for n in places],
        "depths_mm": [
            protocol.depths_mm[last - round(last * k / steps)] for k in reversed(range(kept.depths))
        ],
        "shear": _shear(protocol, kept.cross),
    }
    return _with(protocol, changed)


def spread(places: Sequence[Place]) -> list[int]:
    """Indices in the order in which places are kept: far apart, mirror images last.

    The first is nearest to the centre, for the largest indenter goes whole there; then always the
    one that is farthest from those before it, of places not seen in a mirror yet.
    """
    folded = [(abs(x), abs(y)) for x, y in places]
    order: list[int] = []
    seen: dict[Place, int] = {}
    while len(order) < len(places):
        left = [n for n in range(len(places)) if n not in order]
        fewest = min(seen.get(folded[n], 0) for n in left)
        left = [n for n in left if seen.get(folded[n], 0) == fewest]
        if not order:
            best = min(left, key=lambda n: math.hypot(*folded[n]))
        else:
            best = max(left, key=lambda n: min(math.dist(places[n], places[k]) for k in order))
        order.append(best)
        seen[folded[best]] = seen.get(folded[best], 0) + 1
    return order


def _closest(protocol: Protocol, wanted: float, cross: bool) -> _Thinned:
    """Places and depths whose points are nearest to those wanted, in proportion."""
    one = {
        "indenters": protocol.indenters[:1],
        "positions_mm": protocol.positions_mm[:1],
        "depths_mm": protocol.depths_mm[:1],
        "shear": _shear(protocol, cross),
    }
    of_depth, balls = points_of(_with(protocol, one)) - 1, len(protocol.indenters)
    places, depths = len(protocol.positions_mm), len(protocol.depths_mm)
    could = [
        _Thinned(balls * p * (1 + d * of_depth), p, d, cross)
        for p in range(min(FEWEST, places), places + 1)
        for d in range(min(FEWEST, depths), depths + 1)
    ]
    return min(could, key=lambda one: (abs(math.log(one.points / wanted)), -one.places))


def _shear(protocol: Protocol, cross: bool) -> dict[str, Any] | None:
    if protocol.shear is None:
        return None
    return protocol.shear.model_dump(mode="json") | (_CROSS if cross else {})


def _with(protocol: Protocol, changed: dict[str, Any]) -> Protocol:
    return Protocol.model_validate(protocol.model_dump(mode="json") | changed)
