"""The tabulated level: places moved, depths shared, its error, and what is left to other levels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.gel_tabulated import press_row
from deltact_fab.common.errors import InputError
from deltact_fab.physics.gel.level import GelLevel, Reach
from deltact_fab.physics.gel.level_selection import select_level, table_depth_mm
from deltact_fab.physics.gel.path.knots import Increments, ObservedChannels
from deltact_fab.physics.gel.path.open import choose_level, open_path, open_table_press
from deltact_fab.physics.gel.path.solver import PathSolver
from deltact_fab.physics.gel.press import press_gel
from deltact_fab.physics.gel.tabulated import TabulatedGel, table_weights
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SKIN, GEL, BALL = SkinDimensions(), GelMaterial(1.0, friction=0.0), parse_indenter("sphere:15")
CHANNELS = ObservedChannels(fields="all", traction=True, lattice_mm=1.0)
CELL_MM = 2.0  # coarse; every solution here has it


@pytest.fixture(scope="module", autouse=True)
def _own_store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DELTACT_FAB_CACHE", str(tmp_path_factory.mktemp("store")))
        yield


def opened(
    at: tuple[float, float], depth: float = 1.6, level: GelLevel = "tabulated"
) -> PathSolver:
    poses = Increments(0.8, 1.0).poses([(*at, 0.0), (*at, -depth)])
    cell_mm = None if level == "linear" else CELL_MM
    choice = choose_level(SKIN, GEL, BALL, poses, 0.1, level=level, spacing_mm=cell_mm)
    solver = open_path(SKIN, GEL, BALL, poses, CHANNELS, choice)
    solver.choice = choice
    return solver


def test_table_returns_its_own_places() -> None:
    for place in ((0.0, 0.0), (10.0, 0.0)):
        moved = opened(place)
        a = moved.solve_all()[-1]
        finite = open_table_press(SKIN, GEL, BALL, place, 1.6, CHANNELS, moved.choice)
        assert finite.stored is not None, "solved for the table"
        b = finite.last
        assert a.force_n == pytest.approx(b.force_n, rel=1e-6, abs=1e-6)
        assert a.torque_nmm == pytest.approx(b.torque_nmm, rel=1e-6, abs=1e-5)
        assert a.displacement_mm == pytest.approx(b.displacement_mm, abs=1e-5)
        assert a.zones.contact_area_mm2 == pytest.approx(b.zones.contact_area_mm2, rel=1e-6)
        assert a.zones.centroid_mm == pytest.approx(b.zones.centroid_mm, abs=1e-6)
        assert np.array_equal(a.zone_map, b.zone_map)


def test_moved_press_follows_finite_strain() -> None:
    """Off the lattice, far from the middle; the linear level is four times as far off."""
    solver = opened((9.3, 3.1))
    a, linear = solver.solve_all()[-1], opened((9.3, 3.1), level="linear").solve_all()[-1]
    truth = open_table_press(SKIN, GEL, BALL, (9.3, 3.1), 1.6, CHANNELS, solver.choice)
    b = truth.solve_all()[-1]
    off = np.subtract(a.force_n, b.force_n) / np.linalg.norm(b.force_n)
    assert np.abs(off).max() < 0.003
    off_mm, linear_mm = (np.abs(k.displacement_mm - b.displacement_mm).max() for k in (a, linear))
    assert off_mm < 0.25 * linear_mm
    assert a.zones.contact_area_mm2 == pytest.approx(b.zones.contact_area_mm2, rel=0.05)
    mirrored = opened((-9.3, 3.1))
    assert mirrored.stored is not None
    assert mirrored.last.force_n == (-a.force_n[0], *a.force_n[1:])


def test_tractions_add_up_and_press() -> None:
    solver = opened((7.0, 0.0))
    knot = solver.solve_all()[-1]
    x, y = solver.axes_mm
    total = np.trapezoid(np.trapezoid(knot.traction_mpa, x, axis=1), y, axis=0)
    assert total == pytest.approx(knot.force_n, abs=1e-3 * abs(knot.force_n[2]))
    assert knot.traction_mpa[..., 2].max() <= 0
    arm = np.stack([*np.meshgrid(x, y), 0 * np.meshgrid(x, y)[0]], axis=-1) + knot.displacement_mm
    torque = np.cross(arm, knot.traction_mpa)
    torque = np.trapezoid(np.trapezoid(torque, x, axis=1), y, axis=0)
    radius = np.sqrt(knot.zones.contact_area_mm2 / np.pi)
    assert np.abs(torque - knot.torque_nmm).max() < 0.02 * radius * abs(knot.force_n[2])


def test_any_depth_reads_one_table() -> None:
    assert table_depth_mm(SKIN, BALL, 1.6) == 1.6
    assert table_depth_mm(SKIN, BALL, 0.0126) == pytest.approx(0.016)
    assert table_depth_mm(SKIN, BALL, 2.9) == 3.0  # the linear level's limit
    opened((3.0, 2.0)).solve_all()
    lighter = opened((3.0, 2.0), 1.3)
    assert isinstance(lighter.contact, TabulatedGel)
    nodes = lighter.contact._nodes
    assert [node.place_mm for node in nodes] == [(0.0, 0.0)]
    assert nodes[0].finite.stored is not None
    own = opened((0.0, 0.0), 1.3, "hyperelastic").solve_all()[-1]
    assert opened((0.0, 0.0), 1.3).solve_all()[-1].force_n[2] == pytest.approx(
        own.force_n[2], rel=0.05
    )
    # Unplanned: back up, but neither aside nor below the table.
    first = lighter.next(0, lighter.poses[0].tip_mm, 0.0)
    assert lighter.next(1, (3.0, 2.0, -0.5), 0.0).force_n[2] > first.force_n[2]
    for tip in ((3.2, 2.0, -0.6), (3.0, 2.0, -1.7)):
        with pytest.raises(InputError, match=r"leaves its press to .* use level hyper"):
            lighter.next(1, tip, 0.0)


def test_weights_grow_towards_the_rim() -> None:
    assert table_weights(SKIN, (0.0, 0.0)) == {(0.0, 0.0): 1.0}
    assert table_weights(SKIN, (-10.0, 9.0)) == {(-10.0, 9.0): 1.0}
    weights = table_weights(SKIN, (8.0, -7.0))
    assert sum(weights.values()) == pytest.approx(1.0)
    assert set(weights) == {(0.0, 0.0), (10.0, 0.0), (0.0, -9.0), (10.0, -9.0)}
    narrow = SkinDimensions(width_mm=16.0)
    assert table_weights(narrow, (0.0, 9.0)) == {(0.0, 9.0): 1.0}


@pytest.mark.parametrize(
    ("name", "x", "depth", "changes", "reason"),
    [
        ("sphere:15", (10.1, 10.1), 1.0, {}, "nearer than 8 mm to the rim"),
        ("sphere:15", (0.0, 0.5), 1.0, {}, "moves in plane"),
        ("ring", (0.0, 0.0), 0.5, {}, "ring is not a single ball or ellipsoid"),
        ("4dots", (0.0, 0.0), 0.5, {}, "4dots is not a single ball or ellipsoid"),
        ("sphere:6", (0.0, 0.0), 1.6, {}, "not within 0 to 1.5 mm for sphere:6"),
        ("sphere:22", (0.0, 0.0), 3.1, {}, "over 3 mm, 25% of the thickness"),
        ("sphere:15", (0.0, 0.0), 1.0, {"prony": ((0.2, 1.0),)}, "Prony series"),
    ],
)
def test_outside_of_table_is_hyperelastic(
    name: str, x: tuple[float, float], depth: float, changes: dict[str, Any], reason: str
) -> None:
    gel, reach = replace(GEL, **changes), Reach(x, (0.0, 0.0), depth)
    choice = select_level(SKIN, gel, parse_indenter(name), reach, level="tabulated")
    assert choice.level == "hyperelastic"
    assert choice.reason.startswith("hyperelastic (tabulated: ")
    assert reason in choice.reason
    inside = select_level(SKIN, GEL, BALL, Reach(deepest_mm=1.0), level="tabulated")
    assert inside.level == "tabulated"
    assert inside.model_force_rel > 0


@pytest.mark.slow
def test_press_command_states_its_error() -> None:
    gel = replace(GEL, modulus_mpa=0.56)
    asked: dict[str, Any] = {"model": "tabulated", "spacing_mm": 2.0}
    inside = press_gel(SKIN, gel, BALL, (8.0, 5.0), 1.5, **asked).result
    assert inside["model"] == "tabulated"
    middle = press_gel(SKIN, gel, BALL, (0.0, 0.0), 1.6, model="hyperelastic", spacing_mm=2.0)
    own = middle.result["error_estimate"]
    assert inside["error_estimate"]["force_rel"] > own["force_rel"]
    assert not any(flag.startswith("not tabulated") for flag in inside["flags"])
    outside = press_gel(SKIN, gel, BALL, (12.0, 0.0), 1.5, **asked).result
    assert outside["model"] == "hyperelastic"
    assert any(flag.startswith("not tabulated: ") for flag in outside["flags"])
    assert "nearer than 8 mm" in outside["picked"]["why"]


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, 3])
def test_stated_error_covers_a_press(number: int) -> None:
    """Of the seed that judged the shares; with friction, or on another gel."""
    row = press_row(62, number, 8_000)
    assert abs(row["off"]) <= min(0.015, row["stated"] + row["edge"])
    assert row["in_plane_mm"] <= min(0.015, row["stated_mm"])
    assert row["in_plane_mm"] < 0.3 * row["linear_mm"]
