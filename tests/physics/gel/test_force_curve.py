"""The force curve: one solve for every modulus, smooth between its depths, kept on disk."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.physics.gel.fit.force_curve import ForceCurve, force_curve
from deltact_fab.physics.gel.path import open as opening
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.simulate.virtual.bench_face import hertz_force_n

SKIN = SkinDimensions()
SPHERE = parse_indenter("sphere:15")
SMOOTH = GelMaterial(0.56, 0.49, 0.0)
COARSE = 2.5


def curve(modulus: float = 0.56, deepest: float = 4.0) -> ForceCurve:
    material = GelMaterial(modulus, 0.49, 0.0)
    return force_curve(SKIN, material, SPHERE, (0.0, 0.0), deepest, spacing_mm=COARSE)


def test_one_curve_serves_every_modulus(monkeypatch: pytest.MonkeyPatch) -> None:
    one = curve(0.56)
    monkeypatch.setattr(opening, "open_contact", None)  # nothing more may be solved
    other = curve(1.12)
    np.testing.assert_allclose(other.force_n, 2 * one.force_n, rtol=1e-12)
    assert curve(0.56).force_n.tobytes() == one.force_n.tobytes()


def test_smooth_and_rising_from_zero() -> None:
    c = curve()
    d = np.linspace(-0.5, 4.0, 901)
    f = c.normal_n(d)
    assert (f[d <= 0] == 0).all()
    assert (np.diff(f[d > 0]) > 0).all()
    slope = np.gradient(f, d)[d > 0.05]
    assert np.abs(np.diff(slope)).max() < 0.02 * slope.max()


def test_shallow_press_agrees_with_hertz() -> None:
    """At 0.1 mm the contact is 0.87 mm wide: a bonded layer of 12 mm adds about 8 %, no less."""
    got = curve().normal_n(np.array([0.1]))[0]
    hertz = hertz_force_n(7.5, 0.1, GelMaterial(0.56, 0.49))
    assert 1.04 < got / hertz < 1.12


def test_refusals() -> None:
    with pytest.raises(InputError, match=r"11\.4 mm, 95% of the gel"):
        curve(deepest=11.6)
    with pytest.raises(InputError, match="above 0"):
        curve(deepest=0.0)
