"""Every registered engine states curves and hard cases; its judges can tell right from wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deltact_fab.fabricate.patterns.laws.algorithm1 import Algorithm1
from deltact_fab.physics.gel.level import follow_path
from deltact_fab.physics.gel.linear.contact import LinearContact
from deltact_fab.sensor.elasticity.block import FreeBlock
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.studies.numerics.engine import judge
from deltact_fab.studies.numerics.harness import ENGINE_MODULES, choose_settings, load_engine


@pytest.mark.parametrize("quick", [True, False])
@pytest.mark.parametrize("name", ENGINE_MODULES)
def test_engines_have_curves_and_cases(name: str, quick: bool) -> None:
    engine = load_engine(ENGINE_MODULES[name])
    settings, cases = choose_settings(engine, quick), list(engine.cases(quick))
    assert len(settings) >= 2 or (quick and engine.slow), f"{name} has no curve"
    assert cases, f"{name} has no stability cases"
    cases += engine.extremes()
    assert len({s.key for s in settings}) == len(settings)
    assert any(s.recommended for s in settings) or name == "pattern" or not settings
    assert len({c.name for c in cases}) == len(cases)
    for s in settings:
        assert s.unit
        assert s.reference
        assert np.isfinite(s.reference_error)
    # A refusal for another reason is not the refusal that was expected.
    assert all(c.says for c in cases if "refused" in c.expectation)
    assert any("refused" in c.expectation for c in cases)
    assert any("right" in c.expectation for c in cases)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.slow if n in {"gel", "flow"} else ())
        for n in ENGINE_MODULES
    ],
)
def test_no_quick_case_is_wrong(name: str, tmp_path: Path) -> None:
    rows = [judge(case, tmp_path) for case in load_engine(ENGINE_MODULES[name]).cases(True)]
    assert [r for r in rows if r["outcome"] == "wrong"] == []


def test_distance_detects_another_law() -> None:
    from deltact_fab.studies.numerics.engines.pattern import distance_to_law, violations

    n, limit = 60, 1.95 / np.sqrt(3 * 60 * 60)
    uniforms = np.random.default_rng(1).random((n, n, 3))
    for r in (0.0, 0.1, 0.3, 0.6, 0.95):
        drawn = Algorithm1(r).fill(uniforms)
        assert distance_to_law(drawn, r, 256) < limit
        assert violations(drawn, r) == 0
    for drawn_at, judged_at in ((0.14, 0.1), (0.1, 0.14), (0.6, 0.5)):
        assert distance_to_law(Algorithm1(drawn_at).fill(uniforms), judged_at, 256) > 2 * limit
    assert violations(Algorithm1(0.1).fill(uniforms), 0.14) > 0
    biased = Algorithm1(0.1).fill(uniforms**1.2)
    assert distance_to_law(biased, 0.1, 256) > 2 * limit


def test_modulus_scales_linear_forces_only() -> None:
    found = []
    for modulus_mpa in (0.56e-3, 0.56, 560.0):
        face = FreeBlock(SkinDimensions(), GelMaterial(modulus_mpa), spacing_mm=0.5)
        contact = LinearContact(face, parse_indenter("sphere:10"))
        *_, pressed = follow_path(contact, contact.rest(), (0.0, 0.0, 1.2), 0.6)
        *_, sheared = follow_path(contact, pressed, (0.3, 0.0, 1.2), 0.3)
        found.append((np.array(sheared.force_n) / modulus_mpa, sheared.diagnostics.iterations))
    assert len({iterations for _, iterations in found}) == 1
    for force, _ in found[1:]:
        np.testing.assert_allclose(force, found[0][0], rtol=1e-9, atol=1e-9)
