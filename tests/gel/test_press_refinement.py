"""How `gel press` refines: to the tolerance with the least work, and as far as work goes."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from deltact_fab.gel import refine as module
from deltact_fab.gel.choose import pick
from deltact_fab.gel.level import Choice, Reach
from deltact_fab.gel.material import GelMaterial
from deltact_fab.gel.press import press
from deltact_fab.gel.refine import (
    AIM,
    MOST_WORK,
    SPREAD,
    WORK_POWER,
    Change,
    Errors,
    Problem,
    Run,
    afforded,
)
from deltact_fab.shapes import SkinDimensions
from deltact_fab.shapes.indenter import parse

TOLERANCE = 0.03


@pytest.fixture
def problem() -> Problem:
    return Problem(SkinDimensions(), GelMaterial(), parse("sphere:15"), [(0, 0, 3.0)], TOLERANCE)


@dataclass
class Contact:
    dofs: int


@dataclass
class Done:
    contact: Contact
    states: list[Any] = field(default_factory=list)


@pytest.mark.parametrize(
    ("by_mesh", "by_step"),
    [
        (Errors(0.042, 0.030), Errors(0.014, 0.028)),
        (Errors(0.029, 0.0), Errors(0.007, 0.0)),
        (Errors(0.0, 0.01), Errors(0.0, 0.06)),
        (Errors(0.01, 0.09), Errors(0.04, 0.0)),
    ],
)
def test_what_is_left_of_both_errors_comes_to_the_aim(
    problem: Problem, by_mesh: Errors, by_step: Errors
) -> None:
    spacing, step = problem._finer(by_mesh, by_step)
    left = [m * spacing**2 + s * step for m, s in zip(by_mesh, by_step, strict=True)]
    shares = (left[0] / TOLERANCE, left[1] / problem.in_plane_mm)
    assert max(shares) <= AIM * (1 + 1e-9) or (max(shares) <= 1 and spacing == step == 1)
    assert max(shares) > 0.5  # no finer than needed


def test_no_other_split_of_the_errors_takes_less_work(problem: Problem) -> None:
    mesh, steps = 0.05, 0.03
    spacing, step = problem._finer(Errors(mesh, 0.0), Errors(steps, 0.0))

    def work(for_steps: float) -> float:
        h = ((AIM * TOLERANCE - for_steps) / mesh) ** 0.5
        return h ** -(module.DOFS_POWER * WORK_POWER) * (steps / for_steps)

    least = min(work(AIM * TOLERANCE * k / 100) for k in range(1, 100))
    assert spacing ** -(module.DOFS_POWER * WORK_POWER) / step == pytest.approx(least, rel=1e-3)


def test_parts_of_a_force_cancel_but_never_wholly() -> None:
    def estimate(mesh: float, steps: float, in_plane: float = 0.0) -> tuple[Errors, Errors]:
        parts = (Change(np.array([0.0, 0.0, f]), in_plane) for f in (mesh, steps))
        return module._shares(run, *parts)

    state = SimpleNamespace(force_n=(0.0, 0.0, -10.0))
    run = Run(Contact(1000), [state], ())  # type: ignore[arg-type, list-item]
    by_mesh, by_step = estimate(0.3, -0.1, 0.02)
    assert by_mesh.force_rel + by_step.force_rel == pytest.approx((0.2 + SPREAD * 0.4) / 10)
    assert by_mesh.force_rel == pytest.approx(3 * by_step.force_rel)
    assert by_mesh.in_plane_mm == by_step.in_plane_mm == 0.02  # no sign is known there
    alike = sum(e.force_rel for e in estimate(0.3, 0.1))
    assert alike == pytest.approx((1 + SPREAD) * 0.04)
    opposite = sum(e.force_rel for e in estimate(0.3, -0.3))
    assert opposite == pytest.approx(SPREAD * 0.06)
    assert estimate(0.0, 0.0)[0] == Errors(0.0, 0.0)


def test_a_change_that_happens_to_be_small_is_not_believed(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A force that falls with the square of the cells, but not between the last two meshes."""

    def run(choice: Choice) -> Run:
        h = max(choice.spacing_mm, 1.2)
        state = SimpleNamespace(
            force_n=(0.0, 0.0, -(1 + 0.02 * h**2)),
            displacement_mm=np.zeros((3, 3, 3)),
            diagnostics=SimpleNamespace(cuts=0),
        )
        return Run(Contact(1000), [state] * 5, ())  # type: ignore[arg-type, list-item]

    monkeypatch.setattr(problem, "_run", run)
    choice = pick(
        SkinDimensions(), GelMaterial(friction=0.0), parse("sphere:15"), Reach(deepest_mm=3.0),
        level="hyperelastic", spacing_mm=1.6,
    )  # fmt: skip
    _, first = problem.solve(choice, free=False)
    assert first["force_rel"] > TOLERANCE
    fine, last = problem.solve(choice, free=True)
    spacing = AIM * TOLERANCE / first["force_rel"]
    size = -fine.last.force_n[2]
    assert last["force_rel"] == pytest.approx(
        first["force_rel"] * spacing * (1 + 0.02 * 1.6**2) / size, rel=1e-6
    )
    # What a refinement shows is believed where it is more.
    more, less = (Change(np.array([0.0, 0.0, f]), f) for f in (-0.2, 0.1))
    assert module._larger(more, less) == (more.force_n, 0.1)
    assert module._larger(less, more).force_n is more.force_n


@pytest.mark.parametrize("dofs", [2000, 20_000, 60_000])
@pytest.mark.parametrize("states", [5, 40])
def test_a_refinement_stays_within_the_work_and_coarsens_nothing(dofs: int, states: int) -> None:
    run = Done(Contact(dofs), [None] * states)
    spacing, step = afforded(run, 0.5, 0.3)  # type: ignore[arg-type]
    assert 0.5 <= spacing <= 1
    assert 0.3 <= step <= 1
    done = states * dofs**WORK_POWER
    after = done / step / spacing ** (module.DOFS_POWER * WORK_POWER)
    assert after <= max(MOST_WORK, done) * (1 + 1e-9)


@pytest.mark.slow
def test_what_the_work_does_not_afford_is_refined_in_part(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = (SkinDimensions(), GelMaterial(friction=0.0), parse("sphere:20"), (0.0, 0.0), 6.0)
    monkeypatch.setattr(module, "REFINEMENTS", 0)
    first = press(*asked, tolerance=0.02).result
    monkeypatch.setattr(module, "REFINEMENTS", 1)
    monkeypatch.setattr(module, "MOST_WORK", 2.5e5)  # .7 of the cells would take 4e5
    second = press(*asked, tolerance=0.02).result
    assert not first["within_tolerance"]
    assert 0.75 < second["picked"]["spacing_mm"] / first["picked"]["spacing_mm"] < 0.95
    assert "refined to" in second["picked"]["why"]
    a, b = (r["error_estimate"]["displacement_mm"] for r in (first, second))
    assert b < a


@pytest.mark.parametrize("longest_mm", [10.0, 0.4])
def test_steps_that_were_cut_do_not_hide_what_steps_cost(
    problem: Problem, monkeypatch: pytest.MonkeyPatch, longest_mm: float
) -> None:
    """A press whose solver cuts what is longer than longest_mm, and is off by .01 of its steps."""
    tried = []

    def run(choice: Choice) -> Run:
        tried.append(choice.step_mm)
        cuts = 1 if choice.step_mm > longest_mm else 0
        step = min(choice.step_mm, longest_mm)
        state = SimpleNamespace(
            force_n=(0.0, 0.0, -(1 + 0.01 * step)),
            displacement_mm=np.full((3, 3, 3), 0.01 * step),
            diagnostics=SimpleNamespace(cuts=cuts),
        )
        return Run(Contact(1000), [state], ())  # type: ignore[arg-type, list-item]

    monkeypatch.setattr(problem, "_run", run)
    choice = pick(
        SkinDimensions(), GelMaterial(), parse("sphere:15"), Reach(deepest_mm=3.0),
        level="hyperelastic",
    )  # fmt: skip
    choice = replace(choice, step_mm=0.4)
    *_, by_step = problem._three(choice)
    assert by_step.force_n.tolist() == pytest.approx([0, 0, -0.01 * 0.4])
    assert by_step.in_plane_mm >= 0.01 * 0.4 * 2**0.5
    assert min(tried) == pytest.approx(0.4 if longest_mm > 1 else 0.2)


@pytest.mark.parametrize(
    ("depth_mm", "shear_mm", "model"), [(0.6, 0.0, "layer"), (1.2, 0.5, "hyperelastic")]
)
def test_every_mesh_tells_its_increments_to_the_last(
    depth_mm: float, shear_mm: float, model: Any
) -> None:
    told: list[tuple[int, int, str]] = []
    press(
        SkinDimensions(), GelMaterial(), parse("sphere:15"), (0.0, 0.0), depth_mm, (shear_mm, 0.0),
        model, 0.5, 2.4 if model == "hyperelastic" else 0.5, lambda *of: told.append(of),
    )  # fmt: skip
    starts = [i for i, (done, *_) in enumerate(told) if done == 0]
    assert len(starts) >= 2
    for a, b in zip(starts, [*starts[1:], len(told)], strict=True):
        assert [done for done, *_ in told[a:b]] == list(range(told[a][1] + 1))
        assert model in told[a][2]
