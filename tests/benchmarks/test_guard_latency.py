"""The force guard's byte follows the record, at full recording load; bounds for a busy machine."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import guard


@pytest.mark.slow
def test_every_excess_record_is_stopped() -> None:
    found = guard.measure(40, "jxl")
    assert len(found["whole_ms"]) == 40
    assert found["kept_hz"] > 1
    assert found["failures"] == []
    assert 0 < np.median(found["whole_ms"]) < 200
    assert "40 trips: whole_ms p50" in guard.row(found)
