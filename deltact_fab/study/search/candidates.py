"""The patterns that are compared: families of a law over sizes that can be printed and seen.

All in colour. A printer makes grey of one ink, which the model of three does not hold, and the
tracker takes the colours that it does not follow as its second witness.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ...patterns.recipe import PatternRecipe
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
PAPER = {"law": "algorithm1", "patch_mm": 0.075, "r": 0.6}
"""The paper's choice; it is always among the candidates."""


@dataclass(frozen=True)
class Candidate:
    """A pattern but for its seed. family: what it shares its law with, for leaving one out."""

    name: str
    family: str
    keys: tuple[tuple[str, Any], ...]

    def recipe(self, seed: int) -> PatternRecipe:
        """It, drawn with a seed; no marker dots."""
        return PatternRecipe(seed=seed, **dict(self.keys))

    def plain(self, seed: int) -> dict[str, Any]:
        """Its recipe as plain data."""
        return self.recipe(seed).model_dump(mode="json", exclude_none=True)

    @property
    def is_paper(self) -> bool:
        """Whether it is the paper's choice."""
        return dict(self.keys) == PAPER


def candidates(mm_per_dot: float, mm_per_px: float) -> list[Candidate]:
    """All of them that a printer of that pitch can print and a camera of that scale can see."""
    least_mm = max(MIN_DOTS * mm_per_dot * (1 - 1e-9), MIN_PX * mm_per_px / (1 + 1e-9))
    return [
        candidate
        for candidate in _all()
        if least_mm <= dict(candidate.keys)["patch_mm"] <= MAX_PX * mm_per_px or candidate.is_paper
    ]


def _all() -> Iterator[Candidate]:
    for d in SIZES_MM:
        for r in R:
            yield _made(f"algorithm1 d {d:g} r {r:g}", "Algorithm 1",
                        law="algorithm1", patch_mm=d, r=r)  # fmt: skip
        for law in ("iid", "binary") if d <= MAX_RANDOM_MM else ():
            yield _made(f"{law} d {d:g}", law, law=law, patch_mm=d)
        for blocks in SCALES if d <= MAX_OCTAVE_MM else ():
            scales = tuple(round(d * side, 9) for side in blocks)
            words = "/".join(f"{scale:g}" for scale in scales)
            yield _made(f"octave {words}", "octave", law="octave", patch_mm=d, scales_mm=scales)


def _made(name: str, family: str, **keys: Any) -> Candidate:
    return Candidate(name, family, tuple(keys.items()))


MIN_CANDIDATES = 8


@dataclass(frozen=True)
class Size:
    """candidates: how many; seeds, held_out: of the search and of what confirms it.

    finalists: patterns that are confirmed. drag: share of the protocol's shear.
    """

    candidates: int
    seeds: int
    held_out: int
    finalists: int
    drag: float


def size_of(scale: float, whole: int) -> Size:
    """At scale 1: all candidates with 2 seeds; 4 finalists with 5 held-out seeds."""
    return Size(
        candidates=min(whole, max(MIN_CANDIDATES, round(scale * whole))),
        seeds=max(1, round(2 * scale)),
        held_out=max(2, round(5 * scale)),
        finalists=max(2, round(4 * scale)),
        drag=scale,
    )


def thinned(
    among: list[Candidate], count: int, kept: tuple[dict[str, object], ...]
) -> list[Candidate]:
    """This many of them, evenly over families; the paper's and those in kept are among them."""
    must = [i for i, c in enumerate(among) if dict(c.keys) in (PAPER, *kept)]
    by_family = sorted(range(len(among)), key=lambda i: among[i].family)
    free = [i for i in by_family if i not in must]
    wanted = max(0, count - len(must))
    step = len(free) / wanted if wanted else 1.0
    some = {free[int(k * step)] for k in range(wanted)}
    return [c for i, c in enumerate(among) if i in some or i in must]


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
