"""One interface over two levels: the same lattice, wrenches of a mirrored mesh, flags."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from deltact_fab.common.aliases import Field
from deltact_fab.common.errors import InputError, SolverError
from deltact_fab.physics.gel.level import (
    GelContact,
    GelLevel,
    IncrementDiagnostics,
    Reach,
    State,
    follow_path,
)
from deltact_fab.physics.gel.level_selection import select_level
from deltact_fab.physics.gel.linear.contact import ContactState
from deltact_fab.physics.gel.linear.gel import LinearGel
from deltact_fab.physics.gel.path.open import open_contact
from deltact_fab.physics.gel.zones import hermite, means
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SKIN, GEL = SkinDimensions(), GelMaterial()


def opened(level: GelLevel, tips: list[tuple[float, float, float]], **more: Any) -> GelContact:
    scene = SKIN, GEL, parse_indenter(more.pop("indenter", "sphere:15"))
    lattice_mm = more.pop("lattice_mm", 0.5)
    return open_contact(
        *scene, select_level(*scene, Reach.around(tips), level=level, **more), lattice_mm
    )


def over_face(x_mm: Field, y_mm: Field, field: Field) -> Field:
    """Integral over the face of a lattice field (ny, nx, ...), by trapezoids."""
    return np.trapezoid(np.trapezoid(field, x_mm, axis=1), y_mm, axis=0)


def end(contact: GelContact, *tips: tuple[float, float, float]) -> State:
    state = contact.rest((*tips[0][:2], 0.0))
    for tip in tips:
        *_, state = follow_path(contact, state, tip, contact.choice.step_mm)
    return state


@pytest.mark.parametrize("level", ["linear", pytest.param("hyperelastic", marks=pytest.mark.slow)])
def test_levels_agree_at_light_touch(level: GelLevel) -> None:
    tip = (0.0, 0.0, 0.5)
    spacing = 0.75 if level == "hyperelastic" else 0.5
    contact = opened(level, [tip], spacing_mm=spacing)
    state = end(contact, tip)
    assert contact.level == level
    assert contact.x_mm[[0, -1]] == pytest.approx([-18, 18])
    assert contact.y_mm[[0, -1]] == pytest.approx([-17, 17])
    shape = (len(contact.y_mm), len(contact.x_mm))
    assert state.displacement_mm.shape == (*shape, 3)
    assert state.traction_mpa.shape == (*shape, 3)
    # The integral equation's 1.152 N for a layer without sides, finite strain's 1.140 N.
    assert -state.force_n[2] == pytest.approx(1.14, rel=0.03)
    assert (state.diagnostics.most_stretch is None) == (level != "hyperelastic")


@pytest.mark.parametrize(
    ("level", "lattice_mm"),
    [("linear", 1.5), pytest.param("hyperelastic", 0.3, marks=pytest.mark.slow)],
)
def test_tractions_sum_to_the_wrench(level: GelLevel, lattice_mm: float) -> None:
    """Off the middle, off the nodes and dragged; lattices finer and coarser than grid and mesh."""
    tips = [(6.3, -4.1, 1.0), (6.8, -3.9, 1.0)]
    spacing = 2.0 if level == "hyperelastic" else 0.4
    contact = opened(level, tips, lattice_mm=lattice_mm, spacing_mm=spacing)
    state = end(contact, *tips)
    traction, force = state.traction_mpa, np.array(state.force_n)
    size = float(np.linalg.norm(force))
    assert np.linalg.norm(force[:2]) > 0.3 * size
    found = over_face(contact.x_mm, contact.y_mm, traction)
    assert np.linalg.norm(found - force) < 1e-9 * size
    x, y = np.meshgrid(contact.x_mm, contact.y_mm)
    arm = np.stack([x, y, 0 * x], axis=-1) + state.displacement_mm
    torque = over_face(contact.x_mm, contact.y_mm, np.cross(arm, traction))
    radius = np.sqrt(state.zones[0].contact_area_mm2 / np.pi)
    assert np.linalg.norm(torque - state.torque_nmm) < 0.01 * size * radius
    assert traction[..., 2].max() <= 0
    # A part's size and a lattice cell beyond the contact at most.
    away = np.hypot(x - tips[-1][0], y - tips[-1][1])[np.abs(traction).max(axis=-1) > 0]
    assert away.max() < radius + np.sqrt(2) * (lattice_mm + spacing) + 0.2


def test_means_keep_sums_moments_and_constants() -> None:
    rng = np.random.default_rng(4)
    edges, at = np.sort(rng.uniform(-3, 3, 30)), np.sort(rng.uniform(-3, 3, 12))
    edges[[0, -1]] = at[[0, -1]] = -3, 3
    values = rng.uniform(size=29)
    found = means(edges, at) @ values
    width, middle = np.diff(edges), (edges[1:] + edges[:-1]) / 2
    one = np.array([0.0, 1.0])
    assert over_face(at, one, np.tile(found, (2, 1))) == pytest.approx((width * values).sum())
    first = over_face(at, one, np.tile(at * found, (2, 1)))
    assert first == pytest.approx((width * middle * values).sum())
    assert means(edges, at).sum(axis=1) == pytest.approx(np.ones(12))
    assert means(edges, at).min() >= 0
    # What hangs over an end is counted to the last node.
    edges[0], edges[-1] = -3.5, 3.2
    width = np.diff(edges)
    found = means(edges, at) @ values
    assert over_face(at, one, np.tile(found, (2, 1))) == pytest.approx((width * values).sum())


@pytest.mark.slow
def test_mirrored_mesh_has_full_wrench() -> None:
    """The same press on a quarter and on all of one mesh."""
    tip = (0.0, 0.0, 1.5)
    scene = SKIN, GEL, parse_indenter("sphere:15")
    choice = select_level(*scene, Reach.around([tip]), level="hyperelastic", spacing_mm=2.0)
    # A whole number of cells from the mirrors on.
    choice = replace(choice, focus=(-8.0, 8.0, -8.0, 8.0))
    part, whole = (
        open_contact(*scene, replace(choice, mirrors=m), 0.45)
        for m in ((True, True), (False, False))
    )
    a, b = end(part, tip), end(whole, tip)
    assert 3.0 < whole.dofs / part.dofs < 4.5
    assert a.force_n[:2] == (0.0, 0.0)
    assert a.force_n == pytest.approx(b.force_n, rel=1e-6, abs=1e-6)
    assert a.torque_nmm == pytest.approx(b.torque_nmm, abs=1e-5)
    for name, value in vars(b.zones[0]).items():
        assert vars(a.zones[0])[name] == pytest.approx(value, rel=1e-3, abs=1e-3)
    assert (a.zones[1] != b.zones[1]).mean() < 1e-3
    assert a.displacement_mm == pytest.approx(b.displacement_mm, abs=1e-6)
    assert a.traction_mpa == pytest.approx(b.traction_mpa, abs=1e-6)


def test_lattice_interpolation_has_third_order() -> None:
    def error(n: int) -> float:
        s = np.linspace(0, 1, n)
        knots = s + 0.15 * np.sin(2 * np.pi * s)
        at = np.linspace(0, 1, 301)
        w = hermite(knots, at)
        assert w @ (knots**2 - 2 * knots) == pytest.approx(at**2 - 2 * at, abs=1e-13)
        return float(np.abs(w @ np.sin(5 * knots) - np.sin(5 * at)).max())

    assert error(41) < error(21) / 6


def test_invalid_press_is_refused() -> None:
    with pytest.raises(InputError, match="depth 12 mm is not below the gel's thickness of 12 mm"):
        opened("hyperelastic", [(0.0, 0.0, 12.0)])
    with pytest.raises(InputError, match=r"level linear: depth 4 mm is over 3 mm.*hyperelastic"):
        opened("linear", [(0.0, 0.0, 4.0)])
    with pytest.raises(InputError, match=r"x = 0 to 20 mm leaves the face of \+-18 mm"):
        opened("hyperelastic", [(0.0, 0.0, 1.0), (20.0, 0.0, 1.0)])
    with pytest.raises(InputError, match=r"y = -18 to 0 mm leaves the face of \+-17 mm"):
        opened("hyperelastic", [(0.0, 0.0, 1.0), (0.0, -18.0, 1.0)])
    with pytest.raises(InputError, match="not resolved by cells of 3 mm"):
        opened("hyperelastic", [(0.0, 0.0, 1.0)], indenter="sphere:2", spacing_mm=3.0)
    with pytest.raises(InputError, match="valid: auto, linear"):
        opened("thick", [(0.0, 0.0, 1.0)])  # type: ignore[arg-type]
    contact = opened("hyperelastic", [(0.0, 0.0, 1.0)], spacing_mm=3.0)
    with pytest.raises(InputError, match="mirror plane x = 0"):
        contact.solve(contact.rest(), (1.0, 0.0, 1.0))


def test_coarse_mesh_at_edge_is_flagged() -> None:
    tip = (0.0, 0.0, 1.0)
    contact = opened("hyperelastic", [tip], indenter="hexprism", spacing_mm=2.0)
    flags = end(contact, tip).diagnostics.flags
    assert any(f.id == "penetration" and "below 2 mm" in f.text for f in flags)


@pytest.mark.slow
def test_jump_stays_flagged_until_contact_ends() -> None:
    """The star on cells as coarse: its points snap over the edges one after the other."""
    tip = (0.0, 0.0, 5.5)
    contact = opened("hyperelastic", [tip], indenter="star", spacing_mm=1.72)

    def friction(state: State) -> str:
        return "; ".join(f.text for f in state.diagnostics.flags if f.id == "friction")

    states = list(follow_path(contact, contact.rest(), tip, 0.5))
    told = [friction(s) for s in states]
    first = next(i for i, text in enumerate(told) if text)
    assert 0 < first < len(states) - 1
    assert "no equilibrium was found" in told[first]
    assert all(told[first:])
    assert "the gel jumped earlier" in told[first + 1]
    # With a longer increment, too; and only what has let go starts afresh.
    assert friction(contact.solve(states[first - 2], tip))
    free = contact.solve(states[-1], (0.0, 0.0, -1.0))
    assert not friction(free)
    assert not friction(contact.solve(free, (0.0, 0.0, 0.5)))


@pytest.mark.slow
def test_long_friction_increment_is_divided() -> None:
    tip = (0.0, 0.0, 10.0)
    contact = opened("hyperelastic", [tip], spacing_mm=2.0)
    one = contact.solve(contact.rest(), tip)
    seven = list(follow_path(contact, contact.rest(), tip, 1.5))
    assert one.force_n == seven[-1].force_n
    assert one.diagnostics.iterations == sum(s.diagnostics.iterations for s in seven)
    assert one.diagnostics.cuts == sum(s.diagnostics.cuts for s in seven)
    *_, fine = follow_path(contact, contact.rest(), tip, 0.5)
    assert one.force_n[2] == pytest.approx(fine.force_n[2], rel=0.05)
    # The engine under it takes an increment as long as it is asked for.
    press = contact.press  # type: ignore[attr-defined]
    bare = press.solve(press.rest(), tip).force_n[2] * press.mesh.copies
    assert bare != pytest.approx(fine.force_n[2], rel=0.1)


def test_parts_as_one_keep_every_count() -> None:
    counts = ("iterations", "factorisations", "damped", "lagged", "cuts")
    first, last = (
        IncrementDiagnostics(**dict.fromkeys(counts, n), residual=0.1 / n, flags=(f"n: {n}",))
        for n in (2, 5)
    )
    assert IncrementDiagnostics.combine([first, last]) == replace(last, **dict.fromkeys(counts, 7))


def test_unconverged_increment_is_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    contact = opened("linear", [(0.0, 0.0, 1.0), (1.0, 0.0, 1.0)], spacing_mm=0.5)
    assert isinstance(contact, LinearGel)
    pressed = contact.solve(contact.rest(), (0.0, 0.0, 1.0))
    halves = contact.solve(contact.solve(pressed, (0.5, 0.0, 1.0)), (1.0, 0.0, 1.0))
    inner, solve = contact.contact, contact.contact.solve

    def short(before: ContactState, tip_mm: tuple[float, float, float]) -> ContactState:
        if tip_mm[0] - before.tip_mm[0] > 0.6:
            raise SolverError("pressure and friction do not agree")
        return solve(before, tip_mm)

    monkeypatch.setattr(inner, "solve", short)
    assert contact.solve(pressed, (1.0, 0.0, 1.0)).force_n == halves.force_n
    monkeypatch.setattr(inner, "solve", lambda *_: short(pressed.inner, (9.0, 0.0, 1.0)))
    with pytest.raises(SolverError, match="do not agree"):
        contact.solve(pressed, (1.0, 0.0, 1.0))
