"""What a study's page says of its gel's modulus, which is known to a factor of 2.

Stresses of the simulated gel are in proportion to it at one and the same deformation (so is every
force that is solved here: `gel.path` solves for 1 MPa).
"""

from __future__ import annotations

from ..preflight.peaks import MODULUS_FACTOR

ALSO = {
    "force-calibration": " Only the force sensor's noise and range do not scale: in a gel of half "
    "the modulus noise counts twice.",
    "settling": " Waits for an error in N are those of half or twice as strict a share.",
}
"""By study: what else depends on it, what is fixed in newtons meeting forces at another place."""


def remark(study: str, modulus_mpa: float) -> str:
    """For a study's notes: how well the modulus is known, and what that changes."""
    return (
        f"The gel's modulus, {modulus_mpa:g} MPa, is known to a factor of {MODULUS_FACTOR:g} "
        "(Gent's relation from Shore 15A). Deformation at a given depth does not depend on it, nor "
        "does what follows from deformation alone: images, flow, tracking errors, depth, contact, "
        "how fast a force fades, shares of a force. Forces and tractions, and their errors in N "
        f"and kPa, are in proportion to it.{ALSO.get(study, '')}"
    )
