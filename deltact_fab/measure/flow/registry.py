"""Trackers by the names that reports and command lines use."""

from __future__ import annotations

from ...errors import InputError, did_you_mean
from .method import FLOW_METHODS, FUSED
from .renewed import Renewal
from .tracker import FlowTracker, Reference

PAPER = "paper"
# How the flow is kept from the first image on: its reference and when that is renewed.
REFERENCES: dict[str, tuple[Reference, Renewal]] = {
    "anchored": ("anchored", "adaptive"),
    "composed": ("composed", "adaptive"),
    "summed": ("summed", "adaptive"),
    "static": ("static", "adaptive"),
    "composed-every": ("composed", "every-frame"),
    "summed-every": ("summed", "every-frame"),
}


def named_tracker(name: str, *, full: bool = True) -> FlowTracker:
    """The tracker of a name: `method`, `method/reference` or `paper`.

    `fused` alone is anchored, any other method alone is composed. `paper` is what the paper says:
    Farneback's flow, summed, the reference renewed by a photometric threshold. Raises InputError
    with the valid names.
    """
    if name == PAPER:
        return FlowTracker("farneback-paper", "summed", "photometric", full=full)
    method, _, kept = name.partition("/")
    if method not in FLOW_METHODS:
        known = (PAPER, *FLOW_METHODS)
        raise InputError(f"flow method {method!r}: unknown; {did_you_mean(method, known)}")
    kept = kept or ("anchored" if method == FUSED else "composed")
    known = tuple(k for k in REFERENCES if k != "anchored" or method == FUSED)
    if kept not in known:
        raise InputError(
            f"flow reference {kept!r} of {method!r}: not available; {did_you_mean(kept, known)}"
        )
    return FlowTracker(method, *REFERENCES[kept], full=full)
