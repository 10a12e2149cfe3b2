"""What is dimensioned on the drawing of each part, as data in terms of its dimensions.

Every point and every number comes from the dimensions the part is made from; nothing is measured
on the drawing.
"""

from __future__ import annotations

from collections.abc import Callable

from ..dimensions import Design
from ..registry import Part
from . import inner_parts, molds, outer_parts
from .indenters import indenter
from .items import Callouts

_BY_NAME: dict[str, Callable[[Design], Callouts]] = {
    "acrylic": outer_parts.acrylic,
    "skin-frame": outer_parts.skin_frame,
    "transparent-base": outer_parts.skin_frame,
    "shell": outer_parts.shell,
    "testing-shell": outer_parts.testing_shell,
    "light-holder": inner_parts.light_holder,
    "camera-holder": inner_parts.camera_holder,
    "cover": inner_parts.cover,
    "mold": molds.mold,
    "coupon-mold": molds.coupon,
}


def has(part: Part) -> bool:
    """Whether a part has callouts, and so a drawing."""
    return part.indenter is not None or part.name in _BY_NAME


def of(part: Part, design: Design) -> Callouts | None:
    """The callouts of a part; None for a part without a drawing."""
    if part.indenter is not None:
        return indenter(part.indenter)
    maker = _BY_NAME.get(part.name)
    return maker(design) if maker else None
