"""The natural decomposition: what is one kind of field is found to be, and nothing leaks."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure import hodge
from deltact_fab.estimate.measure.hodge import Hodge, curl, divergence

H, W = 90, 120
Y, X = np.mgrid[0:H, 0:W] - np.array([(H - 1) / 2, (W - 1) / 2])[:, None, None]


def _bump(x0: float, y0: float, sigma: float) -> np.ndarray:
    return np.exp(-((X - x0) ** 2 + (Y - y0) ** 2) / (2 * sigma**2))


def _pure_d(sigma: float = 8.0) -> np.ndarray:
    """Gradient of a Gaussian that is nothing at the edges; about 1 at most."""
    return np.stack((-(X - 9) / sigma, -(Y + 5) / sigma), -1) * _bump(9, -5, sigma)[..., None]


def _pure_r(sigma: float = 8.0) -> np.ndarray:
    return hodge.rotated(_pure_d(sigma))[::-1, ::-1]


HARMONIC = {
    "a shift": np.stack((0 * X + 0.3, 0 * X - 0.2), -1),
    "a saddle": np.stack((X, -Y), -1) / 60,
    "a saddle on edge": np.stack((Y, X), -1) / 60,
    "second order": np.stack((X * X - Y * Y, -2 * X * Y), -1) / 3600,
}


def _rms(a: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(a, dtype=float))))


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_parts_lack_curl_or_divergence(kind):
    noise = np.random.default_rng(1).normal(size=(H, W, 2)) * 0.1
    field = (_pure_d() + 2 * _pure_r() + HARMONIC["second order"] + noise).astype(kind)
    found = Hodge(field)
    limit = 1e-4 if kind is np.float32 else 1e-7
    assert found.h.dtype == kind
    for part in (found.h, found.r):
        assert _rms(divergence(part)) < limit * _rms(divergence(field))
    for part in (found.h, found.d):
        assert _rms(curl(part)) < limit * _rms(curl(field))
    assert np.allclose(found.d + found.r + found.h, field, atol=1e-6)
    assert np.array_equal(found.hr, field - found.d)


def test_pure_fields_recovered_to_second_order():
    sigma = 4.0
    d, r = _pure_d(sigma), _pure_r(sigma)
    error = 0.25 / sigma**2
    for field, part in ((d, "d"), (r, "r")):
        found = Hodge(field)
        assert np.abs(getattr(found, part) - field).max() < error
        other = {"d": "r", "r": "d"}[part]
        assert np.abs(getattr(found, other)).max() < error
        assert np.abs(found.h).max() < error


@pytest.mark.parametrize("name", HARMONIC)
def test_harmonic_polynomial_is_h(name):
    field = HARMONIC[name]
    found = Hodge(field)
    assert np.abs(found.h - field).max() < 1e-9
    assert np.abs(found.d).max() < 1e-9


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_non_finite_field_is_refused(bad):
    field = np.zeros((8, 8, 2))
    field[3, 3, 0] = bad
    with pytest.raises(InputError, match="non-finite"):
        Hodge(field)
