"""Drags that hide a part of the pattern and show it again: what is sure is right, and it is most.

Short on the linear gel, to guard edits; whole, from an empty store, as evidence.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from rig_text import VIRTUAL_STAGE

from deltact_fab import experiment
from deltact_fab.analysis.tracking_error import analyse

SHORT = """
name = "short-deep-drag"
indenters = ["sphere:10"]
positions_mm = [[0.0, 0.0]]
depths_mm = [3.0]
channels = ["image", "shear"]
[shear]
amplitude_mm = 4.0
axes = ["x"]
[capture]
rate_hz = 1.0
[motion]
press_feed_mm_min = 30.0
shear_feed_mm_min = 30.0
[specimen]
gel_model = "linear"
"""
COARSE = f"""{VIRTUAL_STAGE}[force]
range_n = [50.0, 50.0, 70.0]
range_nmm = [500.0, 500.0, 500.0]
[virtual.gel]
spacing_mm = 0.5
press_increment_mm = 0.5
shear_increment_mm = 1.0
"""


def dragged(protocol: str, rig: str, out: Path, *methods: str) -> dict[str, dict[str, Any]]:
    """Figures by method of a protocol that is run and analysed."""
    experiment.run(experiment.RunRequest(protocol, rig, out, seed=0))
    with ThreadPoolExecutor(1) as executor:
        result = analyse(out, methods, executor)
    assert result.verdict.take == "fused"
    return {row["name"]: row for row in result.methods}


@pytest.mark.slow
def test_a_short_deep_drag(tmp_path: Path) -> None:
    protocol, rig = tmp_path / "short.toml", tmp_path / "coarse.toml"
    protocol.write_text(SHORT)
    rig.write_text(COARSE)
    rows = dragged(str(protocol), str(rig), tmp_path / "run", "fused", "dis-medium")
    sure, composed = rows["fused"], rows["dis-medium"]
    assert sure["peak_true_mm"] > 3
    assert sure["mean_off_dots_mm"] <= 0.004
    assert sure["mean_confident_mm"] <= 0.003
    assert sure["coverage"] >= 0.95
    assert sure["confident_wrong_share"] <= 0.0005
    # Flow that is composed wanders off, and does not only lose what it cannot see.
    assert composed["mean_off_dots_mm"] > 2 * sure["mean_off_dots_mm"]


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("protocol", "all_mm", "sure_mm", "coverage", "wrong"),
    [
        ("deep-drag", 0.006, 0.003, 0.95, 0.0005),
        ("deeper-drag", None, 0.003, 0.88, 0.001),
    ],
)
def test_a_whole_deep_drag_from_an_empty_store(
    protocol: str,
    all_mm: float | None,
    sure_mm: float,
    coverage: float,
    wrong: float,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("DELTACT_FAB_CACHE", str(tmp_path / "store"))
    row = dragged(protocol, "virtual", tmp_path / "run", "fused")["fused"]
    assert row["peak_true_mm"] > 4
    if all_mm is not None:
        assert row["mean_off_dots_mm"] <= all_mm
    assert row["mean_confident_mm"] <= sure_mm
    assert row["coverage"] >= coverage
    assert row["confident_wrong_share"] <= wrong
