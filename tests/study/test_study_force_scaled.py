"""The force study's protocol at any scale: what is thinned, and what never is."""

from __future__ import annotations

from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deltact_fab.errors import InputError
from deltact_fab.protocols import plan
from deltact_fab.protocols.plan import Protocol
from deltact_fab.study.force.simulated import points_of, scaled, spread

FEWEST_POINTS = 190
"""Five balls, two places, two depths, a grid of shear, and one at rest."""
ABOVE = 1.25


@cache
def whole() -> Protocol:
    return plan.load("force-calibration")[0]


def folded(protocol: Protocol) -> set[tuple[float, float]]:
    return {(abs(x), abs(y)) for x, y in protocol.positions_mm}


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.floats(1e-4, 1.0))
def test_any_scale_keeps_the_indenters_the_range_and_places_to_leave_out(scale: float) -> None:
    thin = scaled(whole(), scale)
    assert thin.indenters == whole().indenters
    assert len(folded(thin)) >= 2
    assert set(thin.positions_mm) <= set(whole().positions_mm)
    assert (thin.depths_mm[0], thin.depths_mm[-1]) == (0.4, 1.6)
    assert set(thin.depths_mm) <= set(whole().depths_mm)
    shears = [protocol.shear for protocol in (thin, whole())]
    assert len({shear and shear.at_depth_mm(1.6) for shear in shears}) == 1
    wanted = scale * points_of(whole())
    assert points_of(thin) >= FEWEST_POINTS
    if wanted > FEWEST_POINTS:
        assert 1 / ABOVE <= points_of(thin) / wanted <= ABOVE


def test_the_whole_is_the_papers() -> None:
    assert scaled(whole(), 1.0) == whole()
    assert points_of(whole()) == 9 * (5 * 9 + 1) * 5 == 2070


def test_places_are_kept_far_apart_and_mirror_images_last() -> None:
    order = [whole().positions_mm[n] for n in spread(whole().positions_mm)]
    assert order[:2] == [(0.0, 0.0), (6.0, 5.0)]
    assert {(abs(x), abs(y)) for x, y in order[:4]} == folded(whole())
    assert sorted(order) == sorted(whole().positions_mm)


@pytest.mark.parametrize("scale", [0.0, -0.1, 1.01, float("nan")])
def test_another_scale_is_refused(scale: float) -> None:
    with pytest.raises(InputError, match="at most 1"):
        scaled(whole(), scale)
