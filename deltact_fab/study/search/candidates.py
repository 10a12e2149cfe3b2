"""The patterns that are compared: a law each over sizes that can be printed and seen.

All in colour. A printer makes grey of one ink, which the model of three does not hold, and the
tracker takes the colours that it does not follow as its second witness.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...patterns.recipe import DEFAULT_SEED, PatternRecipe
from ...protocols.plan import Protocol

SIZES_MM = (0.05, 0.075, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6)
MIN_DOTS = 3.0
"""Printer dots a patch: fewer, and halftone and misplaced ink leave none of its own colour."""
MIN_PX, MAX_PX = 1.5, 16.0
"""Camera pixels a patch: fewer alias; in larger ones a matching window has no edge in it."""
R = (0.1, 0.3, 0.6)
SCALES = ((1, 2), (1, 2, 4), (1, 2, 4, 8))
"""Sides of octave noise's blocks, in patches."""
MAX_OCTAVE_MM, MAX_RANDOM_MM = 0.2, 0.3
"""The one's coarse blocks give what larger patches would; of the other, larger ones are worse:
where neighbours happen to be alike, there is nothing to follow."""
PAPER = "algorithm1 d 0.075 r 0.6"
"""The paper's choice; it is always among the candidates."""


def name_of(recipe: PatternRecipe) -> str:
    """Law and sizes of a pattern."""
    if recipe.scales_mm:
        return f"{recipe.law} {'/'.join(f'{scale:g}' for scale in recipe.scales_mm)}"
    r = "" if recipe.r is None else f" r {recipe.r:g}"
    return f"{recipe.law} d {recipe.patch_mm:g}{r}"


def candidates(mm_per_dot: float, mm_per_px: float) -> dict[str, PatternRecipe]:
    """All of them, by name, that a printer of that pitch can print and a camera can see."""
    least_mm = max(MIN_DOTS * mm_per_dot * (1 - 1e-9), MIN_PX * mm_per_px / (1 + 1e-9))
    return {
        name: recipe
        for recipe in _all()
        if least_mm <= (recipe.patch_mm or 0.0) <= MAX_PX * mm_per_px or name_of(recipe) == PAPER
        for name in (name_of(recipe),)
    }


def _all() -> Iterator[PatternRecipe]:
    for d in SIZES_MM:
        own: dict[str, Any] = {"seed": DEFAULT_SEED, "patch_mm": d}
        for r in R:
            yield PatternRecipe(law="algorithm1", r=r, **own)
        for law in ("iid", "binary") if d <= MAX_RANDOM_MM else ():
            yield PatternRecipe(law=law, **own)
        for blocks in SCALES if d <= MAX_OCTAVE_MM else ():
            scales = tuple(round(d * side, 9) for side in blocks)
            yield PatternRecipe(law="octave", scales_mm=scales, **own)


def thinned(
    among: dict[str, PatternRecipe], count: int, kept: tuple[str, ...]
) -> dict[str, PatternRecipe]:
    """This many of them, evenly over laws; those in kept are among them."""
    free = sorted((name for name in among if name not in kept), key=lambda name: among[name].law)
    wanted = max(0, count - sum(name in among for name in kept))
    step = len(free) / wanted if wanted else 1.0
    some = {free[int(k * step)] for k in range(wanted)}
    return {name: recipe for name, recipe in among.items() if name in some or name in kept}


def shortened(protocol: Protocol, share: float) -> Protocol:
    """With that share of its shear, in whole steps of a frame; at least one."""
    shear, rate_hz = protocol.shear, protocol.capture.rate_hz
    assert shear is not None
    assert shear.amplitude_mm is not None
    assert rate_hz is not None
    step_mm = protocol.motion.shear_feed_mm_min / 60 / rate_hz
    steps = max(1, round(share * shear.amplitude_mm / step_mm))
    kept = shear.model_copy(update={"amplitude_mm": round(steps * step_mm, 6)})
    return protocol.model_copy(update={"shear": kept})
