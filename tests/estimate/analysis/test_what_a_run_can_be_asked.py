"""Runs that have no dots, or nothing but dots: what can be said of them is said."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.estimate.analysis.tracking_error.follow import analyse_tracking
from deltact_fab.estimate.analysis.tracking_error.result import TrackingResult
from deltact_fab.present.report.page import write_run_page
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

PROTOCOL = """
name = "{pattern}"
indenters = ["sphere:10"]
positions_mm = [[0.0, 0.0]]
depths_mm = [1.8]
channels = ["image", "dots"]
[capture]
rate_hz = 0.5
[specimen]
pattern = "{pattern}"
"""


def pressed(pattern: str, mini: tuple[Path, Path], folder: Path) -> Path:
    """The folder of one press on a skin of that pattern."""
    protocol = folder / f"{pattern}.toml"
    protocol.write_text(PROTOCOL.format(pattern=pattern))
    run_experiment(RunRequest(str(protocol), str(mini[1]), folder / "run", seed=3))
    return folder / "run"


def analysed(run: Path, *methods: str) -> TrackingResult:
    with ThreadPoolExecutor(1) as executor:
        return analyse_tracking(run, methods or None, executor)


@pytest.mark.slow
def test_dots_only_skin_is_tracked(mini: tuple[Path, Path], tmp_path: Path) -> None:
    run = pressed("dots", mini, tmp_path)
    result = analysed(run)
    (row,) = result.methods
    assert row["name"] == "dots"
    assert 0 < row["mean_confident_mm"] < 0.01
    assert row["coverage"] == 1
    assert row["mean_off_dots_mm"] is None
    assert result.dots is not None
    assert result.dots["lost"] == 0
    assert result.dots["max_vs_truth_mm"] < 0.1
    assert result.left_out == ["dense flow: the pattern has only dots"]
    assert result.verdict.take == "dots"
    assert "of the moving dots" in result.verdict.line
    assert result.verdict.line in write_run_page(run, tmp_path / "r.html", result).read_text()
    with pytest.raises(InputError, match=r"has only dots \(law 'dot-matrix'\).*'dis-fast'"):
        analysed(run, "dis-fast")


@pytest.mark.slow
def test_flow_is_analysed_without_visible_dots(mini_run: Path, tmp_path: Path) -> None:
    import shutil

    shutil.copytree(mini_run, tmp_path / "r", ignore=shutil.ignore_patterns("analysis"))
    pattern = json.loads((tmp_path / "r" / "pattern.json").read_text())
    pattern["dots_mm"] = [[x + 1.1, y + 0.8] for x, y in pattern["dots_mm"]]  # another sticker's
    (tmp_path / "r" / "pattern.json").write_text(json.dumps(pattern))
    result = analysed(tmp_path / "r", "dis-fast")
    (row,) = result.methods
    assert row["mean_off_dots_mm"] > 0
    assert row["mean_at_dots_mm"] is None
    assert result.dots is None
    assert [line.partition(":")[0] for line in result.left_out] == [
        "error at the dots of sphere-10/p1", "error at the dots of 4dots/p1",
    ]  # fmt: skip
