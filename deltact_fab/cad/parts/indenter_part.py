"""An indenter as a part, and what its drawing says; it is drawn with its tips up."""

from __future__ import annotations

import math
from dataclasses import fields
from itertools import pairwise

from ...shapes import EllipsoidTip, Indenter, PosedTip, RidgeTip
from ...shapes.turned import TurnedTip
from ..design import IndenterBody, IndenterDimensions
from ..drafting.dimensioning import Callouts, Leader, Told, shown, z_of
from ..part import PRINT, RESIN, WHITE, Part, PrintPose
from .indenter import box, build


def part(indenter: Indenter, body: IndenterBody, quantity: int = 1) -> Part:
    """One indenter as a part; a list of indenters (cad/indenters.toml) says which there are."""
    return Part(
        f"indenter-{indenter.slug}",
        RESIN,
        PRINT,
        build,
        box,
        quantity,
        "indenters",
        colour=WHITE,
        callouts=callouts,
        lies=PrintPose("+z", "stem's end", supports="under the plate only"),
        look_for="no mark on the tip; the stem enters the tool holder, flat at +x, by hand",
        indenter=IndenterDimensions(indenter, body),
    )


def callouts(dims: IndenterDimensions) -> Callouts:
    """Plate and stem, and what its kind of tips is made from."""
    indenter, back = dims.indenter, dims.plate_z_mm + dims.body.plate_mm
    lengths = [z_of(back, back + indenter.stem_length_mm, fitted=False)]
    labels: list[Leader] = []
    tip = max(indenter.tips, key=lambda t: (t.x_mm, t.y_mm))
    if isinstance(tip, RidgeTip):
        # Half-way from the nose's top to where its flank begins.
        turn, r = math.radians(90 - tip.flank_deg) / 2, tip.radius_mm
        at = (tip.x_mm + r * math.sin(turn), tip.y_mm, r * (1 - math.cos(turn)))
        words = f"flanks at {shown(tip.flank_deg)}° to the axis"
        labels.append(Leader("front", at, 0, words))
    elif isinstance(tip, EllipsoidTip):
        words = f"half an ellipsoid, semi-axes {shown(tip.a_mm)} (x), {shown(tip.b_mm)} (y and z)"
        labels.append(Leader("front", (tip.x_mm, tip.y_mm, 0), 0, words))
    elif isinstance(tip, TurnedTip):
        for radius_mm in _profile_radii_mm(tip):
            lengths.append(Told(0, -radius_mm, radius_mm, fitted=False, before="Ø"))
    level = "Tips level with one another" if len(indenter.tips) > 1 else "Tip square to the stem"
    posed = [_posed_words(t) for t in indenter.tips if isinstance(t, PosedTip)]
    if any(isinstance(t, PosedTip) and t.tilted for t in indenter.tips):
        level = "Each tip's lowest point at one height"
    notes = (*posed, f"{level}. Contact faces smooth, without support marks.")
    return Callouts(tuple(lengths), notes=notes, labels=tuple(labels), flipped=True)


def _posed_words(posed: PosedTip) -> str:
    """A tip that no view shows square on: its own numbers, and how it is turned."""
    kind = type(posed.tip).__name__.removesuffix("Tip").lower()
    sizes = ", ".join(
        f"{f.name.removesuffix('_mm').replace('_', ' ')} {shown(value)}"
        for f in fields(posed.tip)
        if f.name not in ("x_mm", "y_mm")
        and isinstance(value := getattr(posed.tip, f.name), int | float)
    )
    turns = ", ".join(
        f"{words} {shown(angle)}°"
        for words, angle in (
            ("tilted about x", posed.tilt_x_deg),
            ("about y", posed.tilt_y_deg),
            ("turned about z", posed.turn_deg),
        )
        if angle
    )
    return f"{kind}: {sizes}; {turns}, in this order.".capitalize()


def _profile_radii_mm(tip: TurnedTip) -> list[float]:
    """Radii at which two straight pieces of a turned profile meet: no round tells them."""
    _, drawn = tip.profile()
    return [
        points[-1][0]
        for (kind, points), after in pairwise(drawn)
        if kind == "line" and after[0] == "line"
    ]
