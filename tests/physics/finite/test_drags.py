"""Drags to gross slip beside `benchmarks.gel_twin`, which shares no line with the gel.

docs/evidence/gel.md has all of them.
"""

import pytest

from benchmarks.gel_drags import DRAGS, compare, stored


@pytest.mark.slow
@pytest.mark.parametrize(
    "drag",
    [DRAGS[2], pytest.param(DRAGS[3], marks=pytest.mark.evidence)],
    ids=lambda drag: drag.name,
)
def test_gross_slip_agrees_with_independent_solver(drag) -> None:
    found = compare(drag, stored()[drag])
    assert found.ratios[0] < 0.5
    assert found.ratios[1] > 1
    assert found.side < 0.03
    assert found.normal < 0.02
    assert found.in_plane_mm[0] < 0.01
    assert found.stick < 0.1
