"""Predicted forces, and what a rig says to them before anything moves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.bench.rig import config
from deltact_fab.common.checks import Check
from deltact_fab.common.errors import InputError, SolverError
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.physics.gel.finite.press import FinitePress
from deltact_fab.physics.gel.level import follow_path
from deltact_fab.physics.gel.linear.contact import LinearContact
from deltact_fab.sensor.elasticity.block import FreeBlock
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment
from deltact_fab.simulate.preflight.peaks import (
    Peak,
    PressCurve,
    extrapolate_n,
    predict_peaks,
    press_curve,
)
from deltact_fab.simulate.preflight.rule import ForceLimits, force_checks, limits_of

SENSOR = load_design("deltact")
THICKNESS = SENSOR.skin.thickness_mm
REAL = ForceLimits(
    simulated=False,
    source="my-bench.toml",
    stage_n=(60.0, 60.0, 60.0),
    has_sensor=True,
    sensor_n=(25.0, 25.0, 35.0),
    sensor_nmm=(250.0, 250.0, 250.0),
    origin_mm=(0.0, 0.0, 0.0),
)


@pytest.fixture(scope="module")
def smoke() -> Protocol:
    return plan.load_protocol("smoke")[0]


@pytest.fixture(scope="module")
def deep() -> PressCurve:
    """The paper's sphere to 5 mm, finite strain."""
    found = press_curve(SENSOR.skin, GelMaterial(), parse_indenter("sphere:15"), (0.0, 0.0), [5.0])
    assert found is not None
    return found


def _peaks(protocol: Protocol) -> list[Peak]:
    found = predict_peaks(protocol, SENSOR, (0.0, 0.0, 0.0))
    assert found is not None
    return found


def _over(protocol: Protocol, limits: ForceLimits) -> list[Check]:
    return [
        row for row in force_checks(_peaks(protocol), limits) if row.status == "warn" or row.failed
    ]


def _with(protocol: Protocol, **changes: object) -> Protocol:
    return Protocol.model_validate({**protocol.model_dump(), **changes})


def test_smoke_fits_a_nano17_silently(smoke: Protocol) -> None:
    assert _over(smoke, REAL) == []


def test_check_has_force_and_plate_rows() -> None:
    names = {row.name for row in RunRequest("smoke", "virtual").checks()}
    assert {"peak force", "plate stress"} <= names


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (replace(REAL, stage_n=(60, 60, 10)), ["normal force", "> 10 at", "[stage] max_force_n"]),
        (replace(REAL, stage_n=(5, 60, 60)), ["tangential force", "> 5 at", "max_force_n (N)"]),
        (replace(REAL, sensor_n=(25, 25, 10)), ["normal force", "> 10 at", "[force] range_n"]),
        (replace(REAL, sensor_n=(25, 5, 35)), ["tangential force", "> 5 at", "[force] range_n"]),
        (replace(REAL, sensor_nmm=(250, 20, 250)), ["moment about y", "> 20 at", "range_nmm (N"]),
    ],
)
def test_real_rig_refuses_each_exceeded_limit(
    smoke: Protocol, limits: ForceLimits, words: list[str]
) -> None:
    rows = _over(smoke, limits)
    assert len(rows) == 1
    with pytest.raises(InputError) as caught:
        Check.require(rows, limits.source)
    for word in ["4dots at (0, 0) mm, 1 mm deep", "my-bench.toml: ", "twice", *words]:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("limits", "key"),
    [
        (replace(REAL, stage_n=None), "[stage] max_force_n"),
        (replace(REAL, sensor_n=None), "[force] range_n"),
        (replace(REAL, sensor_nmm=None), "[force] range_nmm"),
    ],
)
def test_real_rig_needs_declared_limits(smoke: Protocol, limits: ForceLimits, key: str) -> None:
    (row,) = _over(smoke, limits)
    wanted = f"my-bench.toml: {key} is not declared, so the force on it cannot be checked"
    assert row.reason == wanted
    with pytest.raises(InputError, match="not declared"):
        Check.require([row], limits.source)


def test_weak_virtual_rig_keeps_the_warning(
    mini: tuple[Path, Path], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rig = tmp_path / "weak.toml"
    text = mini[1].read_text().replace("[60.0, 60.0, 60.0]", "[60.0, 60.0, 2.0]")
    text = text.replace(
        "[force]\nrange_n = [25.0, 25.0, 35.0]\nrange_nmm = [250.0, 250.0, 250.0]\n", ""
    )
    rig.write_text(text)
    protocol = tmp_path / "force.toml"
    words = mini[0].read_text().replace('"image", "dots", ', "").replace(', "4dots"', "")
    protocol.write_text(words)
    summary = run_experiment(RunRequest(str(protocol), str(rig), tmp_path / "run"))
    warned = [n for n in summary["notes"] if n.startswith("WARNING: mini:")]
    # The stage is too weak, and the rig file does not write the sensor's range down.
    assert len(warned) == 2
    assert "[force] range_n is not declared" in warned[0]
    assert "[stage] max_force_n" in warned[1]
    assert all(line.removeprefix("WARNING: ") in caplog.text for line in warned)


def test_only_explicit_limits_count(
    smoke: Protocol, mini: tuple[Path, Path], tmp_path: Path
) -> None:
    declared = limits_of(config.load_rig("virtual")[0], "virtual.toml", smoke)
    assert declared.undeclared() == []
    assert declared.sensor_n == (25.0, 25.0, 35.0)
    rig = tmp_path / "bare.toml"
    lines = mini[1].read_text().splitlines(keepends=True)
    told = ("max_force_n", "[force]", "range_n")
    rig.write_text("".join(line for line in lines if not line.startswith(told)))
    bare = limits_of(config.load_rig(str(rig))[0], "bench.toml", smoke)
    assert bare.undeclared() == ["[stage] max_force_n", "[force] range_n"]


def test_forces_scale_with_the_modulus(smoke: Protocol) -> None:
    stiff = _with(smoke, specimen={**smoke.specimen.model_dump(), "modulus_mpa": 1.12})
    for soft, hard in zip(_peaks(smoke), _peaks(stiff), strict=True):
        assert soft.high.normal_n == pytest.approx(hard.normal_n, rel=1e-12)
        assert soft.high.tangential_n == pytest.approx(hard.tangential_n, rel=1e-12)
        assert soft.high.moment_nmm == pytest.approx(hard.moment_nmm, rel=1e-12)


def test_relaxing_gel_uses_instantaneous_modulus(smoke: Protocol) -> None:
    series = ((0.3, 0.5), (0.2, 5.0))
    relaxing = _with(smoke, specimen={**smoke.specimen.model_dump(), "prony": series})
    for elastic, sudden in zip(_peaks(smoke), _peaks(relaxing), strict=True):
        assert sudden.normal_n == pytest.approx(1.5 * elastic.normal_n, rel=1e-12)


@pytest.mark.slow
def test_linear_drag_is_a_lower_bound(smoke: Protocol) -> None:
    for peak in _peaks(smoke):
        face = FreeBlock(SENSOR.skin, GelMaterial(), spacing_mm=0.25)
        contact = LinearContact(face, parse_indenter(peak.indenter))
        *_, pressed = follow_path(contact, contact.rest(), (0.0, 0.0, 1.0), 0.5)
        for state in follow_path(contact, pressed, (3.0, 0.0, 1.0), 0.75):
            assert abs(state.force_n[0]) <= peak.tangential_n
            assert -state.force_n[2] <= peak.normal_n <= -1.2 * state.force_n[2]
            assert peak.moment_nmm is not None
            assert all(
                abs(t) <= m + 1e-6 for t, m in zip(state.torque_nmm, peak.moment_nmm, strict=True)
            )


def test_moments_count_from_the_declared_origin(smoke: Protocol) -> None:
    far = predict_peaks(smoke, SENSOR, (0.0, 0.0, -50.0))
    assert far is not None
    for near, there in zip(_peaks(smoke), far, strict=True):
        assert near.moment_nmm is not None
        assert there.moment_nmm is not None
        arm = 50.0 - near.depth_mm
        more = arm * near.tangential_n
        assert there.moment_nmm[0] - near.moment_nmm[0] == pytest.approx(more, rel=1e-9)


@pytest.mark.slow
def test_finite_strain_force_at_5_mm(deep: PressCurve) -> None:
    """Axisymmetric twin: 48.8 N without friction, 57.2 N with 1; a coarse mesh adds up to 10 %."""
    force, level = deep.normal_n(5.0)
    assert level == "hyperelastic"
    assert 48.8 <= 0.56 * force <= 57.2 * 1.1


@pytest.mark.slow
def test_extrapolation_lies_above_solved_forces(deep: PressCurve) -> None:
    for depth, force in deep.points[:-1]:
        for deeper, solved in deep.points:
            if deeper > depth:
                assert extrapolate_n(depth, force, deeper, THICKNESS) >= solved
    blind = replace(deep, points=())
    for depth, force in deep.points:
        bound, level = blind.normal_n(depth)
        assert level == "bound"
        assert bound >= force
    beyond, level = deep.normal_n(10.0)
    assert level == "extrapolated"
    assert 0.56 * beyond > 271


def test_refused_solve_reports_bound_and_reason(
    monkeypatch: pytest.MonkeyPatch, smoke: Protocol
) -> None:
    def refuse(*_: object) -> None:
        raise SolverError("press: cannot be solved")

    monkeypatch.setattr(FinitePress, "solve", refuse)
    blunt = _with(
        smoke, indenters=("star",), depths_mm=(4.0,), shear=None, positions_mm=((1.0, 1.0),)
    )
    peak = _peaks(blunt)[0]
    assert (peak.level, peak.reason) == ("bound", "press: cannot be solved")
    rows = [row for row in force_checks([peak], REAL) if row.failed]
    assert rows
    assert all("(bound: press: cannot be solved)" in "".join(row.basis) for row in rows)


def test_depth_outside_the_gel_is_refused() -> None:
    with pytest.raises(InputError, match="12 mm is needed: 12 mm fails"):
        press_curve(SENSOR.skin, GelMaterial(), parse_indenter("sphere:15"), (0.0, 0.0), [12.0])
