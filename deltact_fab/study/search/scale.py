"""How much of a whole search is done at a scale."""

from __future__ import annotations

from dataclasses import dataclass

from ...protocols.plan import Protocol
from .candidates import PAPER, Candidate

MIN_CANDIDATES = 8


@dataclass(frozen=True)
class Size:
    """candidates: how many; seeds, held_out: of the search and of what confirms it.

    finalists, others: patterns that are confirmed, and as many more over the order of the search.
    drag: share of the protocol's shear.
    """

    candidates: int
    seeds: int
    held_out: int
    finalists: int
    others: int
    drag: float


def size_of(scale: float, whole: int) -> Size:
    """At scale 1: all candidates with 2 seeds; 4 finalists and 2 others with 5 held-out seeds."""
    return Size(
        candidates=min(whole, max(MIN_CANDIDATES, round(scale * whole))),
        seeds=max(1, round(2 * scale)),
        held_out=max(2, round(5 * scale)),
        finalists=max(2, round(4 * scale)),
        others=round(2 * scale),
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
