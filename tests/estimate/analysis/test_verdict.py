"""Which method to take, and whether to trust an experiment: the rule as it is told."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import pytest

from deltact_fab.estimate.analysis.tracking_error.result import format_percent, judge_methods
from deltact_fab.estimate.analysis.tracking_error.tally import ErrorTally


def row(name: str, error: float | None, ms: float, **more: Any) -> dict[str, Any]:
    """A reliable method, but for what is said."""
    with_truth = error is not None
    told = {
        "name": name,
        "mean_off_dots_mm": error,
        "ms_per_frame": ms,
        "n_frames": 50,
        "trusted_share": 1.0,
        "confident_share": 0.95,
        "coverage": 0.95 if with_truth else None,
        "confident_wrong_share": 0.0005 if with_truth else None,
    }
    return {**ErrorTally().figures(), **told, **more}


def test_the_least_error_is_taken() -> None:
    verdict = judge_methods(
        [row("slow", 0.004, 40.0), row("quick", 0.007, 7.0), row("bad", 0.05, 5.0),
         row("beaten", 0.008, 9.0)],
        simulated=True,
    )  # fmt: skip
    assert verdict.take == "slow"
    assert verdict.trusted
    assert verdict.line.startswith("Use slow: mean error 0.0040 mm over all moving pixels, 40 ms")
    assert "The flow can be trusted: 100 % of 50 frames" in verdict.line
    assert "(simulated)" in verdict.line


@pytest.mark.parametrize(
    ("doubt", "says"),
    [
        (
            {"confident_wrong_share": 0.02},
            "2 % of the confident pixels are off by more than 0.1 mm",
        ),
        ({"coverage": 0.5}, "50 % of the moving pattern is confident"),
        ({"trusted_share": 0.9}, "90 % of the frames are trusted"),
    ],
)
def test_unreliable_method_is_never_recommended(doubt: dict[str, float], says: str) -> None:
    best, honest = row("best", 0.001, 1.0, **doubt), row("honest", 0.01, 30.0)
    verdict = judge_methods([best, honest], simulated=True)
    assert verdict.take == "honest"
    assert says in verdict.doubts["best"][0]
    alone = judge_methods([best], simulated=True)
    assert alone.take is None
    assert not alone.trusted
    assert alone.line.startswith("Do not trust this experiment: no method is reliable.")
    assert says in alone.line


def test_dot_errors_rank_without_truth() -> None:
    rows = [row("a", None, 9.0, mean_at_dots_mm=0.02), row("b", None, 3.0, mean_at_dots_mm=0.05)]
    verdict = judge_methods(rows, simulated=False)
    assert verdict.take == "a"
    assert "0.0200 mm at the dots" in verdict.line
    assert "95 % of the image" in verdict.line
    assert "no truth to compare with" in verdict.line


def test_single_frame_run_is_not_trusted() -> None:
    verdict = judge_methods([{"name": "a", **ErrorTally().figures()}], simulated=True)
    assert not verdict.trusted
    assert "no frame after the reference" in verdict.line
    json.dumps(asdict(verdict), allow_nan=False)


def test_percentages_near_limits_are_not_rounded() -> None:
    shares = (0, 1e-6, 0.0001, 0.016, 0.5, 0.9995, 1)
    assert [format_percent(share) for share in shares] == [
        "0 %", "under 0.001 %", "0.01 %", "1.6 %", "50 %", "over 99.9 %", "100 %",
    ]  # fmt: skip
