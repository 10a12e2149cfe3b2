"""How `gel press` refines: up a ladder of meshes to the tolerance, and as far as work goes."""

from __future__ import annotations

import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from deltact_fab.common.errors import SolverError, TimeLimit
from deltact_fab.physics.gel import error_control, time_limit
from deltact_fab.physics.gel.error_control import (
    CORRECTION_SHARE,
    SHARP_CONTACT,
    SMOOTH_CONTACT,
    WORK_POWER,
    MeshConvergence,
)
from deltact_fab.physics.gel.level import (
    FINITE_LEVEL,
    Choice,
    IncrementDiagnostics,
    Reach,
    follow_path,
)
from deltact_fab.physics.gel.level_selection import select_level
from deltact_fab.physics.gel.path.knots import KnotPose
from deltact_fab.physics.gel.path.solver import PathSolver
from deltact_fab.physics.gel.press import PRESS_CHANNELS, _solve_levels, press_gel
from deltact_fab.physics.gel.zones import Zones
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

TOLERANCE, RADIUS_MM, DEPTH_MM = 0.03, 4.0, 3.0


class Gel:
    """A contact whose force is off by given functions of cell and step; nothing is solved.

    field_mm: the face's displacement, by the cells. lacking_rel: see `GelContact.lacking_rel`.
    """

    def __init__(
        self, choice: Choice, force: Any, dofs: int, field_mm: Any, lacking_rel: float
    ) -> None:
        self.choice, self.dofs, self._force = choice, dofs, force
        self._field_mm, self._lacking_rel = field_mm(choice.spacing_mm), lacking_rel
        self.x_mm = self.y_mm = np.arange(3.0)

    def rest(self, tip_mm: Any) -> Any:
        return self._state(tip_mm, 0.0)

    def guide(self, states: Any) -> None:
        return None

    def lacking_rel(self, state: Any) -> float:
        return self._lacking_rel

    def solve(self, previous: Any, tip_mm: Any, seconds: float, guide: Any) -> Any:
        return self._state(tip_mm, self._force(self.choice.spacing_mm, self.choice.step_mm))

    def _state(self, tip_mm: Any, size_n: float) -> Any:
        return SimpleNamespace(
            tip_mm=tip_mm,
            force_n=(0.0, 0.0, -size_n),
            torque_nmm=(0.0, 0.0, 0.0),
            zones=(Zones(1.0), np.zeros((3, 3), np.uint8)),
            displacement_mm=np.full((3, 3, 3), self._field_mm),
            diagnostics=IncrementDiagnostics(),
        )


def chosen(friction: float, spacing_mm: float = 1.6) -> Choice:
    return select_level(
        SkinDimensions(), GelMaterial(friction=friction), parse_indenter("sphere:15"),
        Reach(deepest_mm=DEPTH_MM), TOLERANCE, level="hyperelastic", spacing_mm=spacing_mm,
    )  # fmt: skip


def ladder(
    force: Any, dofs: int = 1000, edge_mm: float = 5.0, unknowns: Any = lambda choice: 1000,
    field_mm: Any = lambda spacing_mm: 0.0, lacking_rel: float = 0.0,
) -> MeshConvergence:  # fmt: skip
    """Of a gel that is solved by formula, at the level of finite strain."""
    down = KnotPose((0.0, 0.0, -DEPTH_MM), 0.0, 1.0)

    def opener(choice: Choice, coarser: PathSolver | None) -> PathSolver:
        gel: Any = Gel(choice, force, dofs, field_mm, lacking_rel)
        states = {"coarser": coarser, "keeps_states": True}
        return PathSolver(lambda: gel, [down], None, PRESS_CHANNELS, **states)

    return MeshConvergence(opener, unknowns, RADIUS_MM, edge_mm, TOLERANCE)


def test_first_mesh_within_tolerance_is_returned() -> None:
    found = ladder(lambda h, step: 10.0).refine(chosen(0.0), free=True)
    cells = found.run.choice.spacing_mm / RADIUS_MM
    # Extrapolated from 2.25 times as large cells: the scatter of both meshes.
    weight = 1 / (2.25**2 - 1)
    unresolved = (2.25 * cells / error_control.RESOLVED_CELLS) ** error_control.UNRESOLVED_POWER
    both = np.hypot(1 + weight, weight * unresolved * 2.25**SMOOTH_CONTACT.power)
    scatter = SMOOTH_CONTACT.scatter * cells**SMOOTH_CONTACT.power * both
    assert found.estimate["force_rel"] == pytest.approx(scatter)
    assert scatter < TOLERANCE < scatter * error_control.MESH_RATIO**SMOOTH_CONTACT.power
    assert not found.limited


def test_cells_beyond_second_order_disagree() -> None:
    def force(h: float, step: float) -> float:  # as of a deep ball: of fourth order
        return 10 * (1 + 0.02 * h**4 / 4)

    found = ladder(force).refine(chosen(0.0), free=True)
    off = abs(float(found.force_n[2]) / -10 - 1)
    assert off <= found.estimate["force_rel"] <= TOLERANCE
    # The pair with the least scatter alone was off by more than it stated.
    fine, far = (force(found.run.choice.spacing_mm * r, 0.0) for r in (1.0, 2.25))
    assert abs((fine + (fine - far) / (2.25**2 - 1)) / 10 - 1) > off


def test_cheaper_press_is_given_if_better() -> None:
    meshes = ladder(lambda h, step: 10.0)
    found = meshes.refine(chosen(0.0), free=True)

    def stated(force_rel: float, limited: bool = False) -> error_control.RefinedPress:
        estimate = found.estimate | {"force_rel": force_rel}
        return replace(found, estimate=estimate, limited=limited)

    assert meshes.better(stated(0.02), stated(0.04)).estimate["force_rel"] == 0.02
    assert meshes.better(stated(0.029), stated(0.01)).estimate["force_rel"] == 0.029
    kept = meshes.better(stated(0.11, True), stated(0.032))
    assert (kept.estimate["force_rel"], kept.limited) == (0.032, True)


def test_finite_strain_answers_where_linear_refuses() -> None:
    meshes = ladder(lambda h, step: 10.0)
    found = meshes.refine(chosen(0.0), free=True)
    levels = {"auto": "linear", FINITE_LEVEL: FINITE_LEVEL, "linear": "linear"}

    def choose(model: Any) -> Choice:
        return replace(chosen(0.0), level=levels[model])

    def refine(choice: Choice) -> error_control.RefinedPress:
        if choice.level == "linear":
            raise SolverError("the contact reaches the edge")
        return found

    *_, (choice, refined) = _solve_levels(choose, refine, meshes, "auto")
    assert (choice.level, refined) == (FINITE_LEVEL, found)
    with pytest.raises(SolverError, match="edge"):
        list(_solve_levels(choose, refine, meshes, "linear"))


def test_requested_mesh_is_used() -> None:
    for spacing in (0.8, 2.4):
        found = ladder(lambda h, step: 10.0).refine(chosen(0.0, spacing), free=False)
        assert found.run.choice.spacing_mm == pytest.approx(spacing)


def test_second_order_error_is_removed() -> None:
    def force(h: float, step: float) -> float:
        return 10 * (1 + 0.04 * h**2)

    found = ladder(force).refine(chosen(0.0), free=False)
    assert found.force_n == pytest.approx([0.0, 0.0, -10.0], rel=1e-9)
    correction = 0.04 * 1.6**2 / (1 + 0.04 * 1.6**2)
    assert found.estimate["force_rel"] == pytest.approx(CORRECTION_SHARE * correction, rel=1e-9)
    finer = ladder(force).refine(chosen(0.0), free=True)
    assert finer.estimate["force_rel"] <= TOLERANCE
    assert f"taken {finer.run.choice.spacing_mm:.3g} mm" in finer.run.choice.reason
    assert finer.estimate["force_rel"] > TOLERANCE / 2  # no finer than needed


@pytest.mark.parametrize("lacking_rel", [-0.04, 0.0, 0.02])
def test_force_is_of_hard_contact(lacking_rel: float) -> None:
    press = ladder(lambda h, step: 10.0, lacking_rel=lacking_rel).refine(chosen(0.0), free=False)
    assert press.force_n[2] == pytest.approx(-10 * (1 + lacking_rel))


def test_sharp_edge_is_not_extrapolated() -> None:
    def force(h: float, step: float) -> float:
        return 10 * (1 + 0.01 * h**2)

    press = ladder(force, edge_mm=0.3).refine(chosen(0.0), free=False)
    assert press.force_n[2] == pytest.approx(-force(1.6, 0.0))
    assert press.estimate["force_rel"] == pytest.approx(SHARP_CONTACT.scatter * 1.6 / RADIUS_MM)


def test_peak_error_follows_largest_change() -> None:
    meshes = ladder(lambda h, step: 10.0, field_mm=lambda h: 0.01 * h)
    change_mm = 0.01 * (2.4 - 1.6) * np.sqrt(2)
    estimate = meshes.refine(chosen(0.0), free=False).estimate
    assert estimate["peak_in_plane_mm"] == pytest.approx(SMOOTH_CONTACT.peak * change_mm)


def test_mesh_meets_both_tolerances() -> None:
    meshes = ladder(lambda h, step: 10.0, field_mm=lambda h: 0.02 * h**2)
    by_both = meshes.refine(chosen(0.0), free=True)
    by_force = ladder(lambda h, step: 10.0).refine(chosen(0.0), free=True)
    assert by_both.run.choice.spacing_mm < 0.9 * by_force.run.choice.spacing_mm
    assert 0 < by_both.estimate["displacement_mm"] <= meshes.in_plane_mm


def test_steps_shrink_on_the_coarsest_mesh() -> None:
    solved = []

    def force(h: float, step: float) -> float:
        solved.append((h, step))
        return 10 * (1 - 0.06 * step)

    found = ladder(force).refine(chosen(0.5), free=True)
    step = found.run.choice.step_mm
    assert step < chosen(0.5).step_mm
    assert {s for h, s in solved if h < max(h for h, _ in solved)} == {step}
    assert len(solved) < 12  # each try is a good deal smaller than the one before
    assert found.estimate["force_rel"] >= 0.06 * step
    assert found.estimate["force_rel"] <= TOLERANCE


def test_unsolvable_coarse_mesh_is_skipped() -> None:
    def force(h: float, step: float) -> float:
        if h > 1.7:
            raise SolverError("hides")
        return 10.0

    found = ladder(force).refine(chosen(0.0), free=True)
    assert found.run.choice.spacing_mm < 1.6
    assert found.estimate["force_rel"] <= TOLERANCE
    with pytest.raises(SolverError, match="hides"):
        ladder(force).refine(chosen(0.0, 1.8), free=False)


@pytest.fixture
def clock_s(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time that stands on the solvers' clock, which stands still."""
    now = [0.0]
    monkeypatch.setattr(time_limit.time, "thread_time", lambda: now[0])
    return now


def test_time_limit_returns_best_mesh(clock_s: list[float]) -> None:
    """Each mesh takes a second."""

    def force(h: float, step: float) -> float:
        time_limit.check()
        clock_s[0] += 1.0
        return 10 * (1 + 0.1 * h**2)

    def within(seconds: float) -> error_control.RefinedPress:
        clock_s[0] = 0.0
        with time_limit.within(seconds):
            return ladder(force).refine(chosen(0.0), free=True)

    two = within(2.5)
    assert clock_s[0] == 2, "a third would not have ended in time, and is not begun"
    one = within(1.5)
    assert clock_s[0] == 1
    assert two.limited
    assert two.run.choice.spacing_mm == pytest.approx(1.6 * error_control.MESH_RATIO)
    true = 0.1 * two.run.choice.spacing_mm**2 / (1 + 0.1 * two.run.choice.spacing_mm**2)
    assert two.estimate["force_rel"] == pytest.approx(CORRECTION_SHARE * true)
    # One mesh has nothing to be compared with.
    assert one.limited
    assert one.run.choice.spacing_mm > two.run.choice.spacing_mm
    assert one.estimate["force_rel"] > 0.1
    assert not within(100).limited


def test_short_limit_starts_coarser(clock_s: list[float]) -> None:
    def unknowns(choice: Choice) -> int:
        return int(3e5 / choice.spacing_mm**2.5)

    def force(h: float, step: float) -> float:
        clock_s[0] += 5e-7 * (3e5 / h**2.5) ** WORK_POWER
        return 10.0

    first = 1.6 * error_control.MESH_RATIO**error_control.COARSER_MESHES
    found = []
    for seconds in (100.0, 0.02):
        clock_s[0] = 0.0
        with time_limit.within(seconds):
            found.append(ladder(force, unknowns=unknowns).refine(chosen(0.0), free=True))
    assert [one.limited for one in found] == [False, True]
    assert found[0].run.choice.spacing_mm < first
    assert first < found[1].run.choice.spacing_mm <= error_control.HIDDEN_RADII * RADIUS_MM
    assert found[1].estimate["force_rel"] > TOLERANCE


def test_limit_counts_cpu_time_only() -> None:
    with time_limit.within(0.05):
        time.sleep(0.1)
        time_limit.check()
        while time_limit.remaining_s() > 0:
            pass
        with pytest.raises(TimeLimit):
            time_limit.check()
    time_limit.check(1e9)


@pytest.mark.slow
def test_a_press_returns_within_its_limit() -> None:
    asked = (SkinDimensions(), GelMaterial(), parse_indenter("star"), (0.3, 0.0), 3.0)
    press_gel(*asked, limit_s=2.0)  # loads what it needs
    for limit_s in (0.5, 2.5):
        started_s = time.thread_time()
        result = press_gel(*asked, limit_s=limit_s).result
        assert time.thread_time() - started_s < 1.1 * limit_s + 0.1
        assert not result["within_tolerance"]
    assert result["force_n"] is not None
    assert any(flag.startswith("limit: tolerance not reached in 2.5") for flag in result["flags"])


def test_time_limit_refuses_or_flags() -> None:
    asked = (SkinDimensions(), GelMaterial(), parse_indenter("star"), (0.3, 0.0), 1.2)
    result = press_gel(*asked, tolerance=0.02, limit_s=1e-3).result
    assert result["force_n"] is None
    assert "--limit-s 0.001: no mesh was solved" in result["reason"]
    assert "\n" not in result["reason"]


@pytest.mark.slow
def test_lacking_force_is_energy_slope() -> None:
    from deltact_fab.physics.gel.finite.gel import lacking_n
    from deltact_fab.physics.gel.path.open import open_contact

    skin, ball, gel = SkinDimensions(), parse_indenter("sphere:8"), GelMaterial(friction=0.0)
    choice = select_level(
        skin, gel, ball, Reach(deepest_mm=2.0), level="hyperelastic", spacing_mm=1.5
    )
    contact: Any = open_contact(skin, gel, ball, choice)
    *_, first = follow_path(contact, contact.rest(), (0.0, 0.0, 1.99), contact.choice.step_mm)
    middle = contact.solve(first, (0.0, 0.0, 2.0))
    last = contact.solve(middle, (0.0, 0.0, 2.01))

    def energy(state: Any) -> float:
        tip = np.array(state.inner.tip_mm)
        u = state.inner.displacement_mm
        return float(contact.press.surface.complementary_energy(u, tip)[0])

    slope = (energy(last) - energy(first)) / 0.02
    assert slope > 0
    assert lacking_n(contact.press, middle.inner) == pytest.approx(slope, rel=1e-3)
    # The indenter stands inside the gel: a hard contact would be pressed deeper.
    force = -middle.force_n[2] / contact.press.mesh.copies
    assert 0 < contact.lacking_rel(middle) == pytest.approx(slope / force, rel=1e-3)
