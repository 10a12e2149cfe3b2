"""Presses are planned, solved once, kept, found again by whoever shares them, and never trusted."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.bench.rig.config import GelConfig
from deltact_fab.common.errors import InputError
from deltact_fab.physics.gel.path.knots import Increments
from deltact_fab.physics.gel.path.solver import SOLVED_PATHS, PathSolver
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.simulate.virtual.presses import (
    Presses,
    gel_not_built,
    gel_notes,
    knot_poses,
    press_paths,
    rest_s,
)

COARSE = GelConfig(spacing_mm=1.0, press_increment_mm=0.25, shear_increment_mm=0.5)
SKIN = SkinDimensions()


def declared(**changes: Any) -> Protocol:
    data: dict[str, Any] = {
        "name": "t",
        "indenters": ["sphere:12"],
        "positions_mm": [[0.0, 0.0], [2.0, -1.0]],
        "depths_mm": [0.6],
        "channels": ["image", "force", "shear"],
        "shear": {"amplitude_mm": 1.0, "axes": ["x"]},
        "capture": {"rate_hz": 1.0},
    }
    return Protocol.model_validate(data | changes)


def specimen(**changes: Any) -> Protocol:
    return declared(specimen=changes)


@pytest.fixture(scope="module", autouse=True)
def store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A store of these tests alone, with one press in it."""
    folder = tmp_path_factory.mktemp("store")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DELTACT_FAB_CACHE", str(folder))
        solved(declared())
        yield SOLVED_PATHS.folder


def solved(protocol: Protocol, config: GelConfig = COARSE) -> PathSolver:
    """The first press, whole."""
    presses = Presses(protocol, SKIN, config)
    press = presses.planned_press(presses.paths[0]).solver
    press.solve_all()
    return press


def test_solved_press_is_cached_bit_identical(store: Path) -> None:
    (entry,) = store.glob("*.bin")
    data = entry.read_bytes()
    found = solved(declared())
    assert (found.stored is not None, found.solves) == (True, 0)
    assert all(k.displacement_mm is not None for k in found.knots)
    # A damaged entry is none, and what is solved anew is the same.
    entry.write_bytes(data[: len(data) // 2] + b"x" + data[len(data) // 2 + 1 :])
    again = solved(declared())
    assert again.stored is None
    assert again.solves == len(again.poses) == len(found.knots)
    for a, b in zip(again.knots, found.knots, strict=True):
        assert a.force_n == b.force_n
        assert a.torque_nmm == b.torque_nmm
        assert np.array_equal(a.displacement_mm, b.displacement_mm)
    assert solved(declared()).stored is not None


@pytest.mark.parametrize(
    ("other", "shared"),
    [
        (specimen(pattern="dense", modulus_mpa=0.3), True),
        (declared(motion={"shear_feed_mm_min": 60.0}), True),
        (declared(indenters=["sphere:12", "4dots"]), True),
        (specimen(poisson=0.48), False),
        (specimen(friction=0.4), False),
        (declared(depths_mm=[0.5]), False),
        (declared(shear={"amplitude_mm": 1.5, "axes": ["x"]}), False),
        (declared(indenters=["sphere:11"]), False),
    ],
)
def test_only_mechanics_changes_solve_again(other: Protocol, shared: bool) -> None:
    presses = Presses(other, SKIN, COARSE)
    assert (presses.planned_press(presses.paths[0]).solver.stored is not None) == shared


def test_press_path_is_the_planned_contact() -> None:
    first, second = press_paths(declared())
    assert (first.press, second.press) == ("sphere-12/p1", "sphere-12/p2")
    assert [line.end_mm for line in first.lines] == [
        (0.0, 0.0, -0.6), (1.0, 0.0, -0.6), (-1.0, 0.0, -0.6), (0.0, 0.0, -0.6),
    ]  # fmt: skip
    assert first.lines[0].start_mm == (0.0, 0.0, 0.5)
    assert first.lines[0].seconds == pytest.approx(1.1 / 0.5)
    assert second.deepest_mm == 0.6


def test_rests_matter_for_creeping_gels_only() -> None:
    step = declared(capture={"settle_s": 2.0})
    path = press_paths(step)[0]
    plain, timed = (knot_poses(path, Increments(1.0, 1.0), relaxing_s=t) for t in ((), (5.0, 0.4)))
    assert [p for p in timed if p.part > 0] == plain
    rests = [p for p in timed if p.part == 0]
    stops = len(path.lines) - 1  # the way back to the centre is no stop
    assert sum(p.seconds for p in rests) == pytest.approx(2.0 * stops, rel=1e-12)
    assert {p.tip_mm for p in rests} == {line.end_mm for line in path.lines if line.dwell_s}
    assert len(rests) == stops * len(rest_s(2.0, (5.0, 0.4)))


def test_unplanned_motion_solves_from_the_start() -> None:
    """A stop at a place that no plan knows: the history before it is solved again, and right."""
    found = solved(declared())
    before = 4
    knot = found.next(before, (0.7, 0.0, -0.6), 1.0)
    assert knot.key > len(found.poses)
    assert found.solves == before + 1
    contact = found.contact
    state = contact.rest()
    for pose in found.poses[:before]:
        state = contact.solve(state, (*pose.tip_mm[:2], -pose.tip_mm[2]))
    state = contact.solve(state, (0.7, 0.0, 0.6))
    assert knot.force_n == pytest.approx(state.force_n, rel=1e-9)


def test_cached_press_needs_its_planned_place() -> None:
    presses = Presses(declared(), SKIN, COARSE)
    for name, indenter, at_mm, expected in (
        ("sphere-12/p3", "sphere:12", (2.0, -1.0), "no press 'sphere-12/p3'; valid: sphere-12/p1,"),
        ("sphere-12/p2", "sphere:12", (5.0, 5.0), r"at \(2, -1\) mm, not sphere:12 at \(5, 5\) mm"),
        ("sphere-12/p2", "4dots", (2.0, -1.0), "planned with sphere:12 at .*, not 4dots"),
    ):
        with pytest.raises(InputError, match=expected):
            presses.open(name, indenter, at_mm)
    # a motor step off
    assert presses.open("sphere-12/p2", "sphere:12", (2.0005, -1.0)).solver.poses


@pytest.mark.parametrize("dwell", [0.05, 600.0])
def test_rest_is_split_for_accurate_interpolation(dwell: float) -> None:
    times = (0.3, 3.0, 30.0)
    knots = np.concatenate([[0.0], np.cumsum(rest_s(dwell, times))])
    assert knots[-1] == pytest.approx(dwell, rel=1e-12)
    t = np.linspace(0.0, dwell, 20_001)
    for tau in times:
        between = np.interp(t, knots, np.exp(-knots / tau))
        assert np.abs(between - np.exp(-t / tau)).max() < 0.012


def test_notes_name_presses_without_a_table() -> None:
    places = [[0.0, 0.0], [12.0, 0.0]]
    ids = []
    for positions_mm in (places[:1], places):
        protocol = declared(
            positions_mm=positions_mm, shear=None, channels=["image", "force"],
            specimen={"gel_model": "tabulated"},
        )  # fmt: skip
        presses = Presses(protocol, SKIN, GelConfig())
        choices = [presses.choice(path) for path in presses.paths]
        notes = {note.id: note for note in gel_notes(presses, choices, SKIN)}
        ids.append(set(notes))
        assert "finite-strain gel" not in {note.id for note in gel_not_built(presses, choices)}
    assert [choice.level for choice in choices] == ["tabulated", "hyperelastic"]
    assert ids[1] - ids[0] == {"not tabulated"}
    assert "tabulated gel" in ids[0]
    assert notes["not tabulated"].warns
    assert "1 of 2 presses, sphere-12/p2 the first" in notes["not tabulated"].text
