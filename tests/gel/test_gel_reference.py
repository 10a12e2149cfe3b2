"""The references themselves: a published table, and closed forms that hold together."""

from __future__ import annotations

import pytest

from deltact_fab.elasticity.closed_forms import flat_punch_n_per_mm
from deltact_fab.elasticity.material import GelMaterial

POISSON = (0.3, 0.4, 0.45, 0.5)
# Flat punch on a bonded layer; Hayes et al. (J. Biomech. 5, 1972) agree to .3 % for a/h <= 1.
FACTORS = {
    0.2: (1.2066, 1.2323, 1.2523, 1.2806),
    0.6: (1.7848, 1.9178, 2.0328, 2.2129),
    1.0: (2.4835, 2.7938, 3.0914, 3.6187),
    2.0: (4.3532, 5.2985, 6.4206, 9.1495),
}


@pytest.mark.parametrize("ratio", FACTORS)
def test_flat_punch_table(ratio: float) -> None:
    """kappa in 4 G a kappa/(1 - nu)."""
    found = [
        flat_punch_n_per_mm(ratio, 1.0, GelMaterial(2 * (1 + nu), nu)) * (1 - nu) / (4 * ratio)
        for nu in POISSON
    ]
    assert [round(f, 4) for f in found] == list(FACTORS[ratio])
