"""Every hard case of the finite-strain gel is answered rightly or refused; the quick ones are run
by tests/numerics."""

from __future__ import annotations

from pathlib import Path

import pytest

from deltact_fab.studies.numerics.engine import Case, judge
from deltact_fab.studies.numerics.engines.gel import cases

QUICK = {case.name for case in cases(True)}


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [c for c in cases(False) if c.name not in QUICK], ids=lambda case: case.name
)
def test_is_right_or_refused(case: Case, tmp_path: Path) -> None:
    row = judge(case, tmp_path)
    assert row["outcome"] in ("right", "refused"), row
