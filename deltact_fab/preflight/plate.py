"""What the predicted presses do to the acrylic plate behind the gel; see `cad.stiffness`.

Stress counts with the gel's modulus twice as high, as all that can break does. What the plate
yields is part of the depth that the stage counts and the gel does not see; the simulated sensor's
plate is rigid and leaves it out.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..cad.dimensions import Design
from ..cad.parts.light_holder import below_plate
from ..cad.stiffness import Bending, press
from ..protocols.limits import LimitCheck
from .peaks import MODULUS_FACTOR, Peak


def plate_checks(peaks: Sequence[Peak], design: Design, simulated: bool) -> list[LimitCheck]:
    """Stress, room behind the plate and share of the depth, each with its worst press.

    Too much stress fails, on the simulated rig it warns; the other two only warn.
    """
    done = _presses(peaks, design)
    limit_mpa = design.plate.stress_limit_mpa
    stress = [MODULUS_FACTOR * found.stress_mpa for found in done]
    light = [MODULUS_FACTOR * found.over_ring_mm for found in done]
    share = [f.deflection_mm / p.depth_mm for f, p in zip(done, peaks, strict=True)]
    high = "with twice the modulus"
    yields_mm = max(found.deflection_mm for found in done)
    over = max(stress) > limit_mpa
    return [
        LimitCheck(
            "plate stress", simulated or not over, f"{high}, plate.stress_limit_mpa (MPa)",
            round(max(stress), 2), limit_mpa, _where(stress, peaks), over and simulated,
        ),
        _warning(
            "plate clear of the light holder", f"{high}, least play of light.axial_fit_mm (mm)",
            light, below_plate(design).range_mm[0], peaks,
        ),
        _warning(
            "plate yields",
            f"up to {yields_mm:.3f} mm as expected, which a simulated press leaves out; "
            "share of the depth, plate.deflection_share",
            share, design.plate.deflection_share, peaks,
        ),
    ]  # fmt: skip


def judge_plate(name: str, peaks: Sequence[Peak], design: Design) -> tuple[list[str], list[str]]:
    """Lines of what would break the plate, and of what is only worth knowing.

    name: of the protocol.
    """
    stress, *others = plate_checks(peaks, design, simulated=True)
    breaks = [f"{name}: {_told(stress)}"] if stress.warns else []
    return breaks, [f"{name}: {_told(row)}" for row in others if row.warns]


def _told(row: LimitCheck) -> str:
    return f"{row.name}: {row.what} {row.figure:g} > {row.bound:g}, {row.where}"


def _presses(peaks: Sequence[Peak], design: Design) -> list[Bending]:
    return [press(design, peak.normal_n, peak.at_mm) for peak in peaks]


def _where(figures: Sequence[float], peaks: Sequence[Peak]) -> str:
    worst = peaks[max(range(len(peaks)), key=lambda k: figures[k])]
    x, y = worst.at_mm
    return f"{worst.indenter} at ({x:g}, {y:g}) mm, {worst.depth_mm:g} mm deep"


def _warning(
    name: str, what: str, figures: Sequence[float], bound: float, peaks: Sequence[Peak]
) -> LimitCheck:
    figure = max(figures)
    return LimitCheck(
        name, True, what, float(f"{figure:.3g}"), bound, _where(figures, peaks), figure > bound
    )
