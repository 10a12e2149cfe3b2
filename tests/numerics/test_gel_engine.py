"""The gel's engine: its reference, its judges, and evidence that goes on where it stopped."""

from __future__ import annotations

import ast
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deltact_fab.errors import SolverError
from deltact_fab.gel.finite import FinitePress, FiniteState
from deltact_fab.gel.finite.state import with_diagnostics
from deltact_fab.numerics import evidence, evidence_held, evidence_presses, evidence_tables
from deltact_fab.numerics.engine import Flagged
from deltact_fab.numerics.engines import (
    gel,
    gel_energy,
    gel_run,
    gel_scene,
    gel_sources,
    gel_straight,
)
from deltact_fab.numerics.engines.gel_run import Run
from deltact_fab.numerics.engines.gel_scene import Scene, Solved
from deltact_fab.protocols.plan import load
from deltact_fab.rig.config import FiniteGelConfig


def test_extrapolation_removes_an_error_of_second_order() -> None:
    field = np.random.default_rng(0).standard_normal((5, 4, 2))
    off = np.random.default_rng(1).standard_normal((5, 4, 2))
    cells = (0.75, 0.5)
    found = gel.extrapolated(
        [40 + 3 * h**2 for h in cells], [field + off * h**2 for h in cells], cells[0] / cells[1]
    )
    assert found.normal_n == pytest.approx(40, rel=1e-12)
    assert np.abs(found.in_plane_mm - field).max() < 1e-12
    assert found.force_error == pytest.approx(100 * (1 - 40 / 40.75), rel=1e-9)
    assert found.in_plane_error == pytest.approx(0.25 * gel.rms_mm(off), rel=1e-9)


def test_a_quarter_is_the_whole() -> None:
    one, four = (gel_run.solve(Run("hyperelastic", 2.0, 0.0, 2.5, p)) for p in ("quarter", "whole"))
    truth = gel.Reference(four.normal_n, four.in_plane_mm, 0.0, 0.0)
    force, in_plane = gel.errors(one, truth)
    assert abs(force) < 1e-6
    assert in_plane < 1e-9
    assert gel.rms_mm(four.in_plane_mm) > 0.005


def test_linear_levels_answer_on_the_same_lattice() -> None:
    answers = [
        gel_run.solve(Run("layer", 1.0, 0.0, 0.5)),
        gel_run.solve(Run("hyperelastic", 1.0, 0.0, 2.0)),
    ]
    shapes = {a.in_plane_mm.shape for a in answers}
    assert shapes == {(69, 73, 2)}
    assert answers[0].normal_n == pytest.approx(answers[1].normal_n, rel=0.1)
    a, b = (x.in_plane_mm.ravel() for x in answers)
    assert a @ b > 0.7 * np.linalg.norm(a) * np.linalg.norm(b)


@pytest.fixture(scope="module")
def found() -> Solved:
    return gel_scene.solved(Scene(spacing_mm=3.0), 0.3, (0.0, 0.0, 3.0))


def test_the_judges_see_what_is_wrong(found: Solved) -> None:
    assert abs(gel_scene.work_error(found)) < 5e-3
    assert gel_scene.imbalance(found) < 1e-6
    stronger = [replace(s, force_n=tuple(1.02 * f for f in s.force_n)) for s in found.states]
    wrong = Solved(found.press, tuple(stronger))
    assert gel_scene.work_error(wrong) > 0.015
    assert gel_scene.imbalance(wrong) > 0.01


def test_a_state_that_is_not_trusted_is_flagged(found: Solved) -> None:
    deep = replace(found.last.diagnostics, penetration_mm=0.16)
    hidden = Solved(found.press, (*found.states[:-1], replace(found.last, diagnostics=deep)))
    with pytest.raises(Flagged, match=r"0\.16 mm inside"):
        gel_scene.trusted(hidden)


def test_shear_beyond_the_cone_is_seen() -> None:
    scene = Scene(spacing_mm=3.0, friction=0.5, mirrors=(False, True))
    rubbed = gel_scene.solved(scene, 1.5, (0.0, 0.0, 3.0), (1.0, 0.0, 3.0))
    assert gel_scene.cone_excess(rubbed) < 5e-3
    more = replace(rubbed.last, shear_mpa=1.1 * rubbed.last.shear_mpa)
    assert gel_scene.cone_excess(Solved(rubbed.press, (more,))) > 0.05


def test_energy_from_nowhere_is_seen_and_a_jump_s_loss_is_not_an_error(
    found: Solved, monkeypatch: pytest.MonkeyPatch
) -> None:
    def judged(states: tuple[FiniteState, ...]) -> tuple[float, str]:
        monkeypatch.setattr(gel_energy, "solved", lambda *_: Solved(found.press, states))
        return gel_energy.work_but_jumps(Scene(), 2.0, Path())

    def scaled(factor: float, jumps: bool) -> tuple[FiniteState, ...]:
        last = replace(found.last, force_n=tuple(factor * f for f in found.last.force_n))
        damped = replace(last.diagnostics, damped=int(jumps))
        return (*found.states[:-1], replace(last, diagnostics=damped))

    plain, _ = judged(found.states)
    assert plain < 3  # the trapezoid rule in few steps
    assert judged(scaled(1.5, False))[0] > plain + 5
    lost, note = judged(scaled(1.5, True))
    assert lost < 3
    assert "1 of" in note
    assert judged(scaled(0.5, True))[0] > 5


def test_coverage() -> None:
    share, median = evidence_tables.coverage([(2.0, 1.0), (1.0, 2.0), (9.0, 3.0), (1.0, 1.0)])
    assert share == 0.75
    assert median == 1.5
    assert math.isnan(evidence_tables.coverage([])[0])


def test_random_presses_are_repeatable_and_on_the_face() -> None:
    drawn = [evidence_presses.random_press(i) for i in range(evidence.RANDOM_PRESSES)]
    assert drawn == [evidence_presses.random_press(i) for i in range(evidence.RANDOM_PRESSES)]
    assert len(set(drawn)) == len(drawn)
    for name, (x, y), depth in drawn:
        assert name.startswith(("sphere:", "ellipsoid:"))
        assert abs(x) < 18
        assert abs(y) < 17
        assert 0 < depth <= 6


def test_rows_have_names_and_files_of_their_own() -> None:
    rows = list(evidence.rows())
    assert len({r.name for r in rows}) == len(rows)
    assert len({r.file for r in rows}) == len(rows)
    kinds = {r.name.partition(":")[0] for r in rows}
    assert kinds == {"stability", "reference", "curve", "press", "held", "straight", "drag"}


def imported(path: Path) -> set[Path]:
    """Files of the package that a file's `from` lines name, wherever they stand in it."""
    out = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            folder = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            names = [folder, *(folder / alias.name for alias in node.names)]
            out |= {file for n in names if (file := n.with_suffix(".py")).is_file()}
            out |= {file for n in names if (file := n / "__init__.py").is_file()}
    return out


def reached(*names: str) -> set[Path]:
    """Files of the package that these import, and what those do; of `gel/__init__` none."""
    root = gel_sources.PACKAGE
    known: set[Path] = set()
    todo = {root / name for name in names}
    while todo:
        path = todo.pop()
        known.add(path)
        if path != root / "gel/__init__.py":
            todo |= imported(path) - known
    return known - {root / "gel/__init__.py"}


def said(*patterns: str) -> set[Path]:
    """Files that a key names, and those that hold no figure: errors, units, names of a package."""
    free = ("errors.py", "numerics/engine.py", "catalog.py")
    return {p for g in (*patterns, *free) for p in gel_sources.PACKAGE.glob(g)}


def test_a_line_of_the_table_depends_on_no_more_than_its_key_says() -> None:
    """Else an edit elsewhere would leave it standing as if it were measured."""
    checks = (*gel_sources.CASES, gel_sources.ENERGY, gel_sources.STRAIGHT)
    known = reached(*checks)
    assert gel_sources.PACKAGE / "gel/finite/newton.py" in known
    assert known <= said(*gel_sources.FINITE, *checks, gel_sources.PRISM)


def test_a_picked_mesh_depends_on_no_more_than_its_key_says() -> None:
    known = reached("gel/choose.py", "gel/level.py")
    assert gel_sources.PACKAGE / "gel/linear/sides.py" in known
    # The store of what is solved once for all goes by the hash of what it is made from.
    assert known <= said(*gel_sources.SOLVED, "cache.py", "__init__.py")
    rows = {r.name: r for r in evidence.rows()}
    assert "gel/**/*.py" not in rows["held: star to 5 mm"].sources
    assert set(gel_sources.SOLVED) <= set(rows["held: star to 5 mm"].sources)


def test_a_key_holds_arguments_bounds_and_the_sources_of_its_own_level() -> None:
    rows = {r.name: r for r in evidence.rows()}
    thin = rows["stability: thickness 1 mm, 5% deep: finer mesh"]
    assert "thickness_mm=1.0" in thin.asked
    assert "3.0" in thin.asked
    assert set(thin.sources) == {*gel_sources.FINITE, *gel_sources.CASES}
    assert set(gel_sources.LEVELS) <= set(rows["press: 1"].sources)
    assert gel_sources.PRISM in rows["drag: star to 10 mm, sheared +-10 mm in x"].sources
    worked = rows["stability: edges, no friction, 4 mm deep: work but for jumps"].sources
    assert gel_sources.ENERGY in worked
    assert gel_sources.PRISM not in worked
    (star,) = (r for name, r in rows.items() if name.startswith("straight: star"))
    assert {gel_sources.STRAIGHT, gel_sources.PRISM} <= set(star.sources)
    assert "gel/**/*.py" not in star.sources  # what is picked stands in its words
    opened = rows["stability: depth 12 of 12 mm, announced"]
    assert set(gel_sources.LEVELS) <= set(opened.sources)


def test_only_a_mesh_that_is_no_mirror_makes_a_side_force(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene("hexprism", 2.5, 0.5, mirrors=(False, False))
    none, told = gel_straight.worst_side_force(scene, 0.5, 1.5, 1e-6, Path())
    assert none < 1e-9
    assert "the largest to 1.5 mm" in told
    star = replace(scene, indenter="star", mirrors=(False, True))
    some, told = gel_straight.worst_side_force(star, 0.5, 1.5, 0.03, Path())
    assert 1e-3 < some < 0.2

    # Refused on the way: what was found before decides whether that is all there is to say.
    solve, deep = FinitePress.solve, 0.0

    def to_1_mm(press: FinitePress, previous: Any, tip: Any, seconds: Any = None) -> Any:
        if tip[2] > 1.01:
            if not deep:
                raise SolverError("press: too deep for a test")
            state = solve(press, previous, tip, seconds)
            return with_diagnostics(state, replace(state.diagnostics, penetration_mm=deep))
        state = solve(press, previous, tip, seconds)
        return with_diagnostics(state, replace(state.diagnostics, penetration_mm=0.01))

    monkeypatch.setattr(FinitePress, "solve", to_1_mm)
    with pytest.raises(Flagged, match=r"the largest to 1 mm.*press: too deep for a test"):
        gel_straight.worst_side_force(star, 0.5, 1.5, 0.5, Path())
    found, told = gel_straight.worst_side_force(star, 0.5, 1.5, 1e-6, Path())
    assert found > 1e-6
    assert "too deep for a test" in told
    deep = 0.08
    with pytest.raises(Flagged, match=r"the largest to 1 mm.*0.08 mm inside the gel at 1.5 mm"):
        gel_straight.worst_side_force(star, 0.5, 1.5, 0.5, Path())


def test_caps_are_held_against_the_protocol_and_the_rig_as_they_stand() -> None:
    (protocol, _), config = load("pattern-selection"), FiniteGelConfig()
    every = evidence_held.every_held()
    assert {h.indenter for h in every} == set(protocol.indenters)
    assert {h.depth_mm for h in every} == set(protocol.depths_mm)
    assert max(protocol.depths_mm) == protocol.shear.amplitude_mm == evidence_held.REACH_MM
    assert evidence_held.CAPS[0] == config.most_unknowns
    assert {h.press_increment_mm for h in every} == {config.press_increment_mm}


def test_a_larger_cap_comes_closer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    dragged = evidence_held.Held("ellipsoid", 2.0, 1.0, 1.0, 1.0)
    assert dragged.tips(1) == [(0, 0, 1.0), (0, 0, 2.0), (1.0, 0, 2.0)]
    assert len(dragged.tips(2)) == 6
    held = replace(dragged, shear_mm=0.0)
    monkeypatch.setattr(evidence_held, "CAPS", (1500, 6000))
    result = evidence_held.held_row(held)
    small, large = result["capped"]
    assert small["unknowns"] <= 1500 < large["unknowns"] <= 6000
    assert 0 < large["force_percent"] < small["force_percent"] < 50
    assert 0 < large["in_plane_mm"] < small["in_plane_mm"] < result["largest_in_plane_mm"]
    (row,) = (r for r in evidence.rows() if r.name == "held: star to 5 mm")
    assert "press_increment_mm=0.5" in row.asked
    machine = {"processor": "", "cores": 1}
    entry = {"key": evidence.key_of(row), "result": result, "machine": machine,
             "threads": 1, "load": None, "versions": {}}  # fmt: skip
    (tmp_path / "rows").mkdir()
    (tmp_path / "rows" / row.file).write_text(json.dumps(entry))
    text = evidence_tables.write_up(tmp_path, [evidence.key_of(row)]).read_text()
    assert "What a cap on a path's unknowns costs" in text
    assert text.count("| ellipsoid to 2 mm |") == 2


def test_evidence_goes_on_where_it_stopped(tmp_path: Path) -> None:
    row = "stability: nu 0.5"
    assert evidence.fill(tmp_path, row) == 1
    (path,) = (tmp_path / "rows").iterdir()
    entry = json.loads(path.read_text())
    assert entry["result"]["outcome"] == "refused"
    assert evidence.fill(tmp_path, row) == 0
    entry["key"]["source"] = "older"
    path.write_text(json.dumps(entry))
    assert evidence.fill(tmp_path, row, keep=True) == 0
    keys = [evidence.key_of(r) for r in evidence.rows()]
    text = evidence_tables.write_up(tmp_path, keys).read_text()
    assert "| nu 0.5 | refused |" in text
    assert "1 refused." in text
    assert "1 of them from older sources: stability: nu 0.5" in text
    assert "make evidence" in text


def test_a_row_that_fails_or_takes_too_long_says_so() -> None:
    assert "StopIteration" in evidence.run_row("no such row", 1, 60.0)["failed"]
    assert evidence.run_row("curve: x", 1, 0.01) == {"failed": "no answer within 0.01 s"}


@pytest.mark.parametrize(
    "what",
    [
        pytest.param(what, marks=pytest.mark.slow if what[2] else pytest.mark.evidence)
        for what in gel.OWN_ERROR
    ],
)
def test_a_reference_is_as_good_as_it_says(what: tuple[float, float, bool]) -> None:
    truth = gel.reference(*what)
    force, in_plane = gel.OWN_ERROR[what]
    assert truth.force_error <= force * 1.1
    assert truth.in_plane_error <= in_plane * 1.1
