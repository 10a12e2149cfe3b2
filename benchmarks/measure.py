"""What a row of evidence computes, in the row's own process."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from deltact_fab.studies.numerics.engine import Case, judge


def case_row(case: Case) -> dict[str, Any]:
    """A line of a stability table, judged."""
    with tempfile.TemporaryDirectory() as scratch:
        return judge(case, Path(scratch))
