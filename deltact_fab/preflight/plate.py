"""What the predicted presses do to the acrylic plate behind the gel; see `cad.stiffness`.

Stress counts with the gel's modulus twice as high, as all that can break does. The plate's
deflection is part of the depth that the stage counts and the gel does not see; the simulated
sensor's plate is rigid and leaves it out.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..cad.dimensions import Design
from ..cad.parts.light_holder import below_plate
from ..cad.stiffness import press
from ..protocols.limits import LimitCheck
from .peaks import HIGH, MODULUS_FACTOR, Peak, worst


def plate_checks(peaks: Sequence[Peak], design: Design, simulated: bool) -> list[LimitCheck]:
    """Stress, room behind the plate and share of the depth, each with its worst press.

    Too much stress fails, on the simulated rig it warns; the other two only warn.
    """
    found = [press(design, peak.normal_n, peak.at_mm) for peak in peaks]
    limit_mpa = design.plate.stress_limit_mpa
    stress_mpa, where = worst([MODULUS_FACTOR * f.stress_mpa for f in found], peaks)
    over = stress_mpa > limit_mpa
    deflects_mm = max(f.deflection_mm for f in found)
    return [
        LimitCheck(
            "plate stress", simulated or not over, f"{HIGH}, plate.stress_limit_mpa (MPa)",
            round(stress_mpa, 2), limit_mpa, where, over and simulated,
        ),
        _warning(
            "plate clear of the light holder", f"{HIGH}, least play of light.axial_fit_mm (mm)",
            [MODULUS_FACTOR * f.over_ring_mm for f in found],
            below_plate(design).range_mm[0], peaks,
        ),
        _warning(
            "plate deflection",
            f"up to {deflects_mm:.3f} mm as expected, which a simulated press leaves out; "
            "share of the depth, plate.deflection_share",
            [f.deflection_mm / p.depth_mm for f, p in zip(found, peaks, strict=True)],
            design.plate.deflection_share, peaks,
        ),
    ]  # fmt: skip


def _warning(
    name: str, what: str, figures: Sequence[float], bound: float, peaks: Sequence[Peak]
) -> LimitCheck:
    figure, where = worst(figures, peaks)
    return LimitCheck(name, True, what, float(f"{figure:.3g}"), bound, where, figure > bound)
