"""What a study's page says of its gel's modulus, which is known to a factor of 2.

Stresses of the simulated gel are in proportion to it at one and the same deformation (so is every
force that is solved here: `gel.path` solves for 1 MPa). So it changes newtons, and nothing that is
of the deformation alone: depth, flow, tracking, where a contact is, how fast a force fades. What is
fixed in newtons (noise and range of a force sensor) meets them at another place.
"""

from __future__ import annotations

from ..preflight.peaks import MODULUS_FACTOR

__all__ = ["MODULUS_FACTOR", "remark"]


CHANGES = {
    "force-calibration": "Images do not change, and every figure in newtons, range and error "
    "alike, is in proportion to it; shares of the range, gains and R2 stay. Only the force "
    "sensor's noise and range do not scale: in a gel of half the modulus noise counts twice.",
    "pattern-selection": "Deformation at a given depth, and with it every tracking error and the "
    "order of the patterns, does not depend on it; the force that a press takes does.",
    "shapes": "Shapes, flows, depths and contacts do not depend on it. Forces, tractions and their "
    "errors in N and kPa are in proportion to it; the calibration of force is fitted to the same "
    "gel, so shares of the peak stay.",
    "comparison": "No figure of the table depends on it.",
    "pattern-search": "Deformation at a given depth, and with it the best pattern, does not depend "
    "on it.",
    "settling": "The curve in % and the waits for a share of the force do not depend on it; errors "
    "in N are in proportion to it, and waits for an error in N are those of half or twice as "
    "strict a share.",
}
"""By study: the sentence for its page."""


def remark(study: str, modulus_mpa: float) -> str:
    """For a study's notes: how well the modulus is known, and what that changes here."""
    return (
        f"The gel's modulus, {modulus_mpa:g} MPa, is known to a factor of {MODULUS_FACTOR:g} "
        f"(Gent's relation from Shore 15A). {CHANGES[study]}"
    )
