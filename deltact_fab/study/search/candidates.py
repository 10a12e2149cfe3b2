"""The patterns that are compared: families of a law over sizes that can be printed and seen.

All in colour. A printer makes grey of one ink, which the model of three does not hold, and the
tracker takes the colours that it does not follow as its second witness.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ...patterns.recipe import PatternRecipe

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

    @property
    def is_paper(self) -> bool:
        """Whether it is the paper's choice."""
        return dict(self.keys) == PAPER


def candidates(mm_per_dot: float, mm_per_px: float) -> list[Candidate]:
    """All of them that a printer of that pitch can print and a camera of that scale can see."""
    found = []
    for candidate in _all():
        size_mm = dict(candidate.keys)["patch_mm"]
        printed = size_mm >= MIN_DOTS * mm_per_dot * (1 - 1e-9)
        seen = MIN_PX * mm_per_px <= size_mm * (1 + 1e-9) and size_mm <= MAX_PX * mm_per_px
        if (printed and seen) or candidate.is_paper:
            found.append(candidate)
    return found


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
