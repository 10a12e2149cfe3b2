"""Contact and stick zone of the finite-strain gel against what knows nothing of its meshes.

RIM_MM: between which radii the axisymmetric twin's pressure ends, in the deformed state, without
friction; cells of 1/8 mm for 10 and 15 mm balls, 1/4 for 22. More presses: docs/evidence/gel.md.
"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.gel_axisymmetric import Ball, cylinder
from deltact_fab.common.aliases import Point
from deltact_fab.common.errors import SolverError
from deltact_fab.physics.gel.level import GelContact, Reach, State, follow_path
from deltact_fab.physics.gel.level_selection import select_level
from deltact_fab.physics.gel.path.open import open_contact
from deltact_fab.physics.gel.zones import contact_share, measure_zones
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SKIN = SkinDimensions(36.0, 34.0, 12.0)
RIM_MM = {
    ("sphere:10", 1.0): (2.277, 2.343),
    ("sphere:15", 1.0): (2.906, 2.975),
    ("sphere:15", 1.5): (3.621, 3.671),
    ("sphere:15", 3.0): (5.080, 5.138),
    ("sphere:22", 1.0): (3.569, 3.710),
}


def pressed(name: str, friction: float, *tips: Point) -> tuple[GelContact, State]:
    """The last of these tips, on the mesh that is chosen for them."""
    scene = SKIN, GelMaterial(0.56, 0.49, friction), parse_indenter(name)
    choice = select_level(*scene, Reach.around(tips), level="hyperelastic")
    contact = open_contact(*scene, choice)
    state = contact.rest((*tips[0][:2], 0.0))
    for tip in tips:
        *_, state = follow_path(contact, state, tip, choice.step_mm)
    return contact, state


@pytest.mark.parametrize(("a", "b"), [(3.0, 3.0), (4.0, 2.5)])
def test_rim_of_a_hertzian_gap(a: float, b: float) -> None:
    """An ellipse, known where it touches by squares of half a cell of 1 mm."""
    x, y = np.meshgrid(np.arange(-80, 81) / 10, np.arange(-60, 61) / 10)
    r = np.hypot(x / a, y / b)
    beyond = np.maximum(r - 1, 0.0) * np.hypot(x, y) / np.maximum(r, 1e-9)
    squares = np.hypot((np.floor(2 * x) / 2 + 0.25) / a, (np.floor(2 * y) / 2 + 0.25) / b) < 0.95
    found = contact_share(0.2 * beyond**1.5, squares, 1.0, (0.1, 0.1))
    assert found.sum() * 0.01 == pytest.approx(np.pi * a * b, rel=0.02)
    assert abs(squares.sum() * 0.01 / (np.pi * a * b) - 1) > 0.05


def test_folded_contact_is_refused() -> None:
    axis = np.arange(5.0)
    place = np.stack(np.meshgrid(-axis, axis), axis=-1)  # turned inside out
    touched = np.ones((5, 5))
    with pytest.raises(SolverError, match="folded"):
        measure_zones((axis, axis), place, touched, touched > 0, 1.0, 0.0, (axis, axis))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "depth_mm"),
    [
        pytest.param(*press, marks=() if press == ("sphere:15", 1.5) else pytest.mark.evidence)
        for press in RIM_MM
    ],
)
def test_ball_area_against_axisymmetric_twin(name: str, depth_mm: float) -> None:
    contact, state = pressed(name, 0.0, (0.0, 0.0, depth_mm))
    zones, found = state.zones
    truth_mm2 = np.pi * np.mean(RIM_MM[name, depth_mm]) ** 2
    assert zones.contact_area_mm2 == pytest.approx(truth_mm2, rel=0.03)
    assert abs(zones.contact_area_mm2 - truth_mm2) < zones.contact_area_error_mm2
    assert zones.contact_area_error_mm2 < 0.1 * truth_mm2
    assert zones.centroid_mm == pytest.approx((0, 0), abs=2e-3)  # a sample on the rim
    assert zones.stick_area_mm2 == zones.stick_area_error_mm2 == 0
    cell_mm2 = (contact.x_mm[1] - contact.x_mm[0]) * (contact.y_mm[1] - contact.y_mm[0])
    # At rest, where the map is, the gel that touches is at most a tenth smaller.
    assert 0.88 < (found == 1).sum() * cell_mm2 / zones.contact_area_mm2 < 1.04
    assert not (found == 2).any()


@pytest.mark.evidence
def test_twin_rim_at_coarse_cells() -> None:
    got = cylinder(0.5, float(np.sqrt(36 * 34 / np.pi)), 12.0).press(Ball(7.5), [1.0, 1.5])
    for one in got:
        low, high = RIM_MM["sphere:15", one.depth_mm]
        assert one.rim_mm[0] - 0.05 < low < high < one.rim_mm[1] + 0.05


@pytest.mark.slow
def test_stick_zone_of_a_drag() -> None:
    """Cattaneo and Mindlin's (c/a)^2 is for small strain; a solver of its own, that counts points,
    has 24.9 of 37.2 mm2."""
    _, state = pressed("sphere:15", 0.5, (0.0, 0.0, 1.5), (0.25, 0.0, 1.5))
    zones, found = state.zones
    share = zones.stick_area_mm2 / zones.contact_area_mm2
    sheared = state.force_n[0] / (0.5 * -state.force_n[2])
    assert share == pytest.approx((1 - sheared) ** (2 / 3), abs=0.06)
    assert share == pytest.approx(24.9 / 37.2, abs=0.1)
    assert zones.stick_area_error_mm2 == pytest.approx(0.15 * zones.stick_area_mm2, rel=0.3)
    assert (found == 2).sum() / (found > 0).sum() == pytest.approx(share, abs=0.02)
    # With the ball, and a little ahead of it.
    assert zones.centroid_mm == (pytest.approx(0.3, abs=0.1), pytest.approx(0, abs=1e-9))
