"""The benchmark of the measurement, on its own frames: minutes to draw them once."""

from __future__ import annotations

import json

import pytest

from benchmarks.measure_rate import CASES, run_benchmark


@pytest.mark.evidence
def test_every_case_reports_all_figures():
    found = json.loads(json.dumps(run_benchmark(["0.15/0.1"], frames=120), allow_nan=False))
    cases = found["0.15/0.1"]
    assert tuple(cases) == tuple(CASES)
    for row in cases.values():
        assert row["hz"] > 0
        assert row["cpu_ms"] > 0
        assert row["cpu_ms"] < 3 * sum(row["by_part_ms"].values())
        assert 0 <= row["in_time"] <= 1
        assert 0 < row["latency_ms"]["p50"] <= row["latency_ms"]["p95"]
        assert row["true_motion_mm"] >= 3
    ours = cases["everything"]
    assert ours["mean_error_mm"] < 0.006
    assert ours["coverage"] >= 0.95
