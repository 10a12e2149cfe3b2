"""The stability table of the finite-strain gel: no line wrong. A few here, more when slow, the long
ones by `make evidence`."""

from __future__ import annotations

from pathlib import Path

import pytest

from deltact_fab.numerics.engine import Case
from deltact_fab.numerics.engines.gel import cases
from deltact_fab.numerics.stability import judge

CHEAP = ("depth NaN", "nu 0.5")
TABLE = {case.name: case for case in cases(False)}


def test_the_cheap_ones_are_in_the_table() -> None:
    assert set(CHEAP) <= set(TABLE)


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=name, marks=() if name in CHEAP else pytest.mark.slow)
        for name, case in TABLE.items()
    ],
)
def test_is_right_or_refused(case: Case, tmp_path: Path) -> None:
    row = judge(case, tmp_path)
    assert row["outcome"] in ("right", "refused"), row
