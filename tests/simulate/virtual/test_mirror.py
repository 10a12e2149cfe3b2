"""A press and its mirror image: one solve serves both, and serves them right."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.bench.rig.config import FiniteGelConfig, GelConfig
from deltact_fab.physics.gel.path import open as open_module
from deltact_fab.physics.gel.path.knots import Increments, KnotPose, Mirror, SolvedKnot, mirror_of
from deltact_fab.physics.gel.path.solver import PathSolver
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.simulate.virtual.presolve import solve_presses
from deltact_fab.simulate.virtual.presses import Presses, PressPath, knot_poses, press_paths

GELS = {
    "linear": GelConfig(spacing_mm=1.0, press_increment_mm=0.25, shear_increment_mm=0.5),
    "hyperelastic": GelConfig(
        hyperelastic=FiniteGelConfig(
            cell_mm=1.8, lattice_mm=1.0, press_increment_mm=0.5, shear_increment_mm=2.0
        )
    ),
}
SKIN = SkinDimensions()
FOUR = [[3.0, 2.0], [-3.0, 2.0], [-3.0, -2.0], [3.0, -2.0]]


def declared(**changes: Any) -> Protocol:
    data: dict[str, Any] = {
        "name": "t",
        "indenters": ["ellipsoid"],
        "positions_mm": FOUR,
        "depths_mm": [0.5],
        "channels": ["image", "force", "shear"],
        "shear": {"amplitude_mm": 1.0, "first": "outward"},
        "capture": {"rate_hz": 1.0},
    }
    return Protocol.model_validate(data | changes)


@pytest.fixture(scope="module", autouse=True)
def _own_store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DELTACT_FAB_CACHE", str(tmp_path_factory.mktemp("store")))
        yield


def whole(protocol: Protocol, number: int, level: str) -> PathSolver:
    presses = Presses(protocol, SKIN, GELS[level])
    press = presses.planned_press(presses.paths[number]).solver
    press.solve_all()
    return press


def off(a: SolvedKnot, b: SolvedKnot) -> tuple[float, float, float]:
    """Largest difference of force, torque and displacement over the largest of each."""
    assert a.displacement_mm is not None
    assert b.displacement_mm is not None
    pairs = ((a.force_n, b.force_n), (a.torque_nmm, b.torque_nmm),
             (a.displacement_mm, b.displacement_mm))  # fmt: skip
    found = [float(np.abs(np.subtract(p, q)).max() / np.abs(p).max()) for p, q in pairs]
    return found[0], found[1], found[2]


@pytest.mark.parametrize(
    ("level", "number"), [("linear", 2), pytest.param("hyperelastic", 1, marks=pytest.mark.slow)]
)
def test_mirror_image_matches_own_solve(
    level: str, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    protocol = declared(
        specimen={"gel_model": level}, shear={"amplitude_mm": 1, "axes": ["x"], "first": "outward"}
    )
    first = whole(protocol, 0, level)
    image = whole(protocol, number, level)
    assert first.poses
    assert image.stored is not None
    assert image.solves == 0
    monkeypatch.setattr(open_module, "mirror_of", lambda *_: Mirror())
    own = whole(protocol, number, level)
    assert own.stored is None
    tips = [pose.tip_mm for pose in own.poses]
    assert tips == [pose.tip_mm for pose in image.poses]
    worst = np.max([off(a, b) for a, b in zip(own.knots, image.knots, strict=True)], axis=0)
    assert worst.tolist() == pytest.approx([0, 0, 0], abs=2e-4)  # the solvers' own tolerance


def test_unplanned_image_solves_its_own_frame() -> None:
    protocol = declared()
    whole(protocol, 0, "linear")
    presses = Presses(protocol, SKIN, GELS["linear"])
    a, b = (
        presses.planned_press(presses.paths[n]).solver.next(2, (x, 2.0, -0.5), 1.0)
        for n, x in ((0, 3.3), (1, -3.3))
    )
    assert b.force_n == pytest.approx((-a.force_n[0], *a.force_n[1:]), rel=1e-9)
    assert b.torque_nmm == pytest.approx((a.torque_nmm[0], *(-t for t in a.torque_nmm[1:])))


def way(path: PressPath) -> list[KnotPose]:
    return knot_poses(path, Increments(1.0, 1.0))


def test_only_common_symmetry_planes_are_used() -> None:
    outward, positive = declared(), declared(shear={"amplitude_mm": 1.0})
    there = [mirror_of(way(p), parse_indenter("ellipsoid")) for p in press_paths(outward)]
    assert there == [Mirror(False, False), Mirror(True, False), Mirror(True, True),
                     Mirror(False, True)]  # fmt: skip
    # A star of five points has no mirror plane x = 0.
    assert mirror_of(way(press_paths(outward)[1]), parse_indenter("star")) == Mirror(False, False)
    assert mirror_of(way(press_paths(outward)[2]), parse_indenter("star")) == Mirror(False, True)
    # All go to + first: images in place, but not in path.
    seen = {
        Presses(positive, SKIN, GELS["linear"]).planned_press(p).solver.stored_as
        for p in press_paths(positive)
    }
    assert len(seen) == 4


def test_one_of_four_mirrors_is_solved() -> None:
    heard: list[str] = []
    press = declared(depths_mm=[0.4], shear=None)
    rows = solve_presses(
        [press], SKIN, GELS["linear"], progress=lambda done, of, what: heard.append(what)
    )
    assert [row.like for row in rows] == ["", *["ellipsoid/p1"] * 3]
    assert all(row.done == row.knots and not row.failure for row in rows)
    assert set(heard) == {row.press for row in rows}
    again = solve_presses([press], SKIN, GELS["linear"])
    assert rows[0].zones.contact_area_mm2 > 1
    for row, found in zip(rows, again, strict=True):
        assert row.zones == found.zones  # each where its own indenter is
    assert len({row.zones.centroid_mm for row in rows}) == 4
    assert [(row.found, row.like) for row in again] == [(True, "")] * 4


def test_image_fails_like_its_original() -> None:
    light = declared(positions_mm=[[1.0, 0.0], [-1.0, 0.0]], depths_mm=[0.03], shear=None)
    rows = solve_presses([light], SKIN, GELS["linear"])
    assert rows[0].failure
    assert rows[1].failure == f"as {rows[0].press}, its mirror image: {rows[0].failure}"
