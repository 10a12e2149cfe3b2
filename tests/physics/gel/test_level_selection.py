"""Level, mesh and steps follow from shape, depth, place and tolerance."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deltact_fab.physics.gel.finite.mesh import block_mesh
from deltact_fab.physics.gel.level import Choice, Reach, follow_path, is_mirrored
from deltact_fab.physics.gel.level_selection import select_level
from deltact_fab.physics.gel.linear.validity import model_error
from deltact_fab.physics.gel.path.open import open_contact
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import INDENTER_KINDS, parse_indenter
from deltact_fab.sensor.shapes.rigid import edge_radius_mm
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SKIN, GEL = SkinDimensions(), GelMaterial()


def picked(name: str, x: float, y: float, depth: float, tolerance: float = 0.03) -> Choice:
    return select_level(SKIN, GEL, parse_indenter(name), Reach((x, x), (y, y), depth), tolerance)


def test_deeper_wants_a_better_level() -> None:
    assert picked("sphere:10", 13, 0, 0.1).level == "linear"
    assert picked("sphere:10", 0, 0, 1.0).level == "hyperelastic"
    assert picked("sphere:10", 0, 0, 1.0, 0.1).level == "linear"
    assert picked("sphere:10", 0, 0, 2.0, 0.1).level == "hyperelastic"


@settings(max_examples=25, deadline=None)
@given(
    st.floats(0.3, 3.0), st.floats(0.005, 0.1), st.sampled_from(["sphere:10", "star", "ellipsoid"])
)
def test_tighter_tolerance_never_enlarges_cells(d: float, tol: float, name: str) -> None:
    one, two = (
        select_level(SKIN, GEL, parse_indenter(name), Reach(deepest_mm=d), t, level="hyperelastic")
        for t in (tol, tol / 2)
    )
    assert two.spacing_mm <= one.spacing_mm
    assert two.step_mm <= one.step_mm


def test_cells_grow_to_limit_unknowns() -> None:
    reach = Reach((-7.0, 13.0), (-8.0, 12.0), 10.0)
    free, held = (
        select_level(
            SKIN, GEL, parse_indenter("star"), reach, level="hyperelastic", most_unknowns=n
        )
        for n in (None, 8000)
    )
    assert held.goal_mm == free.goal_mm == free.spacing_mm < held.spacing_mm
    mesh = block_mesh(SKIN, held.spacing_mm, held.focus, held.mirrors)
    assert 7000 < mesh.free_dofs <= 8000
    assert "8000 unknowns; tolerance requires 0.5 mm by its edge radius" in held.reason
    named = select_level(
        SKIN, GEL, parse_indenter("star"), reach, spacing_mm=1.0, most_unknowns=8000
    )
    assert named.spacing_mm == 1.0


# A bonded layer to finite strain, d/h and d/R to 0: the integral equation against the axisymmetric
# solver of tests/finite on a disc of six thicknesses, whose error is below 0.1 %.
@pytest.mark.parametrize(
    ("nu", "h", "radius", "d", "force"),
    [
        (0.485, 9.7, 11.8, 0.1, 0.0054),
        (0.485, 9.7, 11.8, 0.45, 0.0106),
        (0.49, 12.0, 5.0, 0.1, 0.0088),
        (0.49, 12.0, 5.0, 0.45, 0.0195),
        (0.35, 9.0, 8.0, 0.1, 0.0067),
        (0.35, 9.0, 8.0, 0.9, 0.0293),
    ],
)
def test_model_error_by_tip_and_material(
    nu: float, h: float, radius: float, d: float, force: float
) -> None:
    skin = SkinDimensions(thickness_mm=h)
    rule, _ = model_error(skin, parse_indenter(f"sphere:{2 * radius:g}"), d, nu)
    assert force <= rule <= 2 * force


@pytest.mark.parametrize(("name", "depth"), [("sphere:10", 1.0), ("sphere:2", 0.2)])
def test_the_linear_grid_resolves_the_contact(name: str, depth: float) -> None:
    """A grid of a fifth of the spacing moves the force by a tenth of what the level leaves out."""
    forces = []
    for spacing_mm in (None, 0.1):
        scene = SKIN, GEL, parse_indenter(name)
        reach = Reach((0.07, 0.07), (0.03, 0.03), depth)
        choice = select_level(*scene, reach, level="linear", friction=0.0, spacing_mm=spacing_mm)
        contact = open_contact(*scene, choice)
        *_, state = follow_path(
            contact, contact.rest((0.07, 0.03, 0.0)), (0.07, 0.03, depth), depth
        )
        forces.append(state.force_n[2])
    assert forces[0] == pytest.approx(forces[1], rel=5e-3)
    assert choice.model_force_rel > 5e-3


def test_edge_gets_smaller_cells() -> None:
    assert picked("hexprism", 0, 0, 5.0).spacing_mm < picked("sphere:15", 0, 0, 5.0).spacing_mm
    assert edge_radius_mm(parse_indenter("star").tips[0]) == 0.3
    assert edge_radius_mm(parse_indenter("hat").tips[0]) == pytest.approx(0.3)
    assert edge_radius_mm(parse_indenter("ellipsoid").tips[0]) == pytest.approx(2.0)


def test_mirrors_of_indenter_and_path() -> None:
    both = {
        n: (is_mirrored(parse_indenter(n), 0), is_mirrored(parse_indenter(n), 1))
        for n in INDENTER_KINDS[1:]
    }
    assert both.pop("star") == (False, True)
    assert set(both.values()) == {(True, True)}
    assert picked("sphere:10", 0, 3, 5.0).mirrors == (True, False)
    sheared = select_level(SKIN, GEL, parse_indenter("hexprism"), Reach((0, 3), (0, 0), 5.0))
    assert sheared.mirrors == (False, True)


def test_negligible_friction_is_neglected() -> None:
    def friction(depth: float, observe: bool) -> float:
        reach = Reach(deepest_mm=depth)
        return select_level(
            SKIN, GEL, parse_indenter("sphere:10"), reach, observe_shear=observe
        ).friction

    assert friction(0.5, False) == 0.0
    assert friction(0.5, True) == 0.5
    assert friction(5.0, False) == 0.5
