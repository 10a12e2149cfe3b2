"""What predicted presses do to the acrylic plate, and what a rig makes of it."""

from __future__ import annotations

import pytest

from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.stiffness import press_plate
from deltact_fab.simulate.preflight.peaks import Peak
from deltact_fab.simulate.preflight.rule import plate_checks

DESIGN = load_design()
NAMES = ["plate stress", "plate clear of the light holder", "plate deflection"]


def peak(normal_n: float, depth_mm: float = 5.0, at_mm=(0.0, 0.0)) -> Peak:
    return Peak("sphere-10/p1", "sphere:10", 1, at_mm, depth_mm, normal_n, 0.0, None, "linear", "")


@pytest.mark.parametrize("simulated", [True, False])
@pytest.mark.parametrize(
    ("normal_n", "over"), [(25.0, []), (55.0, NAMES[1:2]), (70.0, NAMES[1:]), (271.0, NAMES)]
)
def test_excess_stress_fails_on_real_rig(normal_n, over, simulated):
    rows = plate_checks([peak(1.0), peak(normal_n)], DESIGN, simulated)
    assert [r.name for r in rows] == NAMES
    assert [r.name for r in rows if r.status == "warn" or r.failed] == over
    assert all(not r.failed or (r.name == NAMES[0] and not simulated) for r in rows)
    assert rows[0].failed == (not simulated and normal_n >= 100)
    assert all(r.basis == ("sphere:10 at (0, 0) mm, 5 mm deep",) for r in rows)


def test_plate_figures_use_the_modulus():
    stress, light, yields = plate_checks([peak(10.0, 1.6, (3.0, 2.0))], DESIGN, True)
    found = press_plate(DESIGN, 10.0, (3.0, 2.0))
    assert stress.value == pytest.approx(2 * found.stress_mpa, abs=0.01)
    assert light.value == pytest.approx(2 * found.over_ring_mm, rel=5e-3)
    assert yields.value == pytest.approx(found.deflection_mm / 1.6, rel=5e-3)
    assert f"{found.deflection_mm:.3f} mm predicted, not included in" in yields.subject
