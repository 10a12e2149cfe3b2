"""Trackers of dense flow by name."""

from __future__ import annotations

from ...errors import InputError
from ...measure.flow import FLOW_METHODS, FlowTracker, Reference, Renewal

DEFAULT_METHODS = (
    "dis-medium",
    "dis-fast",
    "farneback",
    "dis-medium/static",
    "dis-medium/summed-every",
    "dis-medium/composed-every",
)
# How the flow is kept from the first image on: the reference's bookkeeping and its renewal.
REFERENCES: dict[str, tuple[Reference, Renewal]] = {
    "composed": ("composed", "adaptive"),
    "summed": ("summed", "adaptive"),
    "static": ("static", "adaptive"),
    "composed-every": ("composed", "every-frame"),
    "summed-every": ("summed", "every-frame"),
}


def check_name(name: str) -> tuple[str, str]:
    """`method` or `method/reference` to its two parts. Raises InputError naming what is valid."""
    method, _, reference = name.partition("/")
    reference = reference or "composed"
    if method not in FLOW_METHODS:
        raise InputError(f"flow method {method!r}: valid: {', '.join(FLOW_METHODS)}")
    if reference not in REFERENCES:
        raise InputError(f"flow reference {reference!r}: valid: {', '.join(REFERENCES)}")
    return method, reference


def tracker(name: str) -> FlowTracker:
    """A new tracker of that name."""
    method, reference = check_name(name)
    return FlowTracker(method, *REFERENCES[reference])
