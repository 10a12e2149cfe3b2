"""What the gel's modulus, known to a factor of 2, changes of what a study says.

Stresses of the simulated gel are in proportion to it at one and the same deformation (so is every
force that is solved here: `gel.path` solves for 1 MPa). So it changes newtons, and nothing that is
of the deformation alone: depth, flow, tracking, where a contact is, how fast a force fades. What is
fixed in newtons (noise and range of a force sensor) meets them at another place.
"""

from __future__ import annotations

from typing import NamedTuple

from ..preflight.peaks import MODULUS_FACTOR

__all__ = ["MODULUS_FACTOR", "Span", "remark", "span", "told"]


class Span(NamedTuple):
    """A figure in proportion to the modulus: as declared, at half of it, at twice."""

    value: float
    low: float
    high: float


CHANGES = {
    "force-calibration": "Ranges, RMSE and limits in N scale with it; R2, and RMSE as a share of "
    "the range, do so only as far as the flow errs and not the force sensor, whose noise in N "
    "stays: in a gel of half the modulus it counts twice.",
    "pattern-selection": "Deformation at a given depth, and with it every tracking error and the "
    "order of the patterns, does not depend on it; the force that a press takes does.",
    "shapes": "Depth, density and contacts do not depend on it; every arrow and total of the "
    "force fields is in proportion to it.",
    "comparison": "No figure of the table depends on it.",
    "pattern-search": "Deformation at a given depth, and with it the best pattern, does not depend "
    "on it.",
    "settling": "The curve in % and the waits for a share of the force do not depend on it; errors "
    "in N are in proportion to it, and waits for an error in N are those of half or twice as "
    "strict a share.",
}
"""By study: the sentence for its page."""


def span(value: float) -> Span:
    """The range of a force, or of anything else in proportion to the modulus."""
    return Span(value, value / MODULUS_FACTOR, value * MODULUS_FACTOR)


def told(value: float, unit: str = "N") -> str:
    """As "9.7 N (4.8 to 19 N for half and twice the modulus)"."""
    at, low, high = span(value)
    return f"{at:.2g} {unit} ({low:.2g} to {high:.2g} {unit} for half and twice the modulus)"


def remark(study: str, modulus_mpa: float) -> str:
    """For a study's notes: how well the modulus is known, and what that changes here."""
    return (
        f"The gel's modulus, {modulus_mpa:g} MPa, is known to a factor of {MODULUS_FACTOR:g} "
        f"(Gent's relation from Shore 15A). {CHANGES[study]}"
    )
