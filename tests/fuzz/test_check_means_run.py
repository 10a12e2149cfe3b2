"""`protocol check` passes exactly what `run` begins, on protocols that are drawn."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import pytest
from wrong_input import VIRTUAL, stop_at_first_motion, toml

from deltact_fab.common.errors import DeltactFabError, Stopped
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

INDENTERS = ("sphere:10", "sphere:2", "4dots", "star:12")
PATTERNS = (*["dense-with-dots"] * 9, "dense", "chessboard", "no-such-pattern", "./gone.toml")


def drawn(number: int) -> dict[str, Any]:
    """A protocol of plausible values, not all of which go together."""
    draw = Random(number)
    channels = draw.sample(["image", "dots", "force", "shear", "traction"], draw.randrange(4))
    if draw.random() < 0.8 and not {"dots", "traction"}.isdisjoint(channels):
        channels = sorted({*channels, "image"})
    deep_mm = draw.choice([0.3, 0.8, 2.0, 2.9, 3.1, 12.5])
    data: dict[str, Any] = {
        "name": f"drawn-{number}",
        "indenters": draw.sample(INDENTERS, draw.choice([1, 1, 2])),
        "positions_mm": [[draw.uniform(-9, 9), draw.uniform(-5, 5)] for _ in range(2)],
        "depths_mm": draw.choice([[deep_mm]] * 4 + [[deep_mm, deep_mm + 0.004], [0.1, deep_mm]]),
        "channels": channels,
        "capture": draw.choice([{"rate_hz": 1.0}, {"settle_s": 0.2}, {"rate_hz": 40.0}]),
        "specimen": {
            "pattern": draw.choice(PATTERNS),
            "gel_model": draw.choice(["linear", "linear", "linear", "hyperelastic"]),
            "poisson": draw.choice([0.49, 0.49, 0.49, 0.3, 0.5]),
            "friction": draw.choice([0.5, 0.0]),
            "prony": draw.choice([[]] * 9 + [[[0.1, 2.0]]]),
        },
    }
    if "shear" in channels:
        data["shear"] = {"amplitude_mm": draw.choice([0.5, 0.5, 2.0, 8.0, 0.01])}
    if draw.random() < 0.4:  # what goes together, for most
        data |= {"depths_mm": [0.2, 0.8], "indenters": [INDENTERS[0]]}
        data["specimen"] = {"pattern": PATTERNS[0], "gel_model": "linear"}
    if draw.random() < 0.1:
        data["motion"] = {"press_feed_mm_min": draw.choice([0.5, 60.0, 1300.0])}
    return data


def passes(request: Callable[[], RunRequest]) -> bool:
    try:
        return not any(row.failed for row in request().checks())
    except DeltactFabError:
        return False


def begins(request: Callable[[], RunRequest]) -> bool:
    try:
        run_experiment(request())
    except DeltactFabError as why:
        return isinstance(why, Stopped)
    raise AssertionError("the run was not stopped")


@pytest.mark.slow
def test_check_passes_what_run_begins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "rig.toml").write_bytes(toml(VIRTUAL))
    monkeypatch.chdir(tmp_path)
    stop_at_first_motion(monkeypatch.setattr)
    # Forces only warn on a virtual rig, and are not what is asked here.
    monkeypatch.setattr(RunRequest, "forces", lambda self, solve=True: None)
    monkeypatch.setattr("deltact_fab.simulate.preflight.peaks.predict_peaks", lambda *a, **k: None)
    begun = 0
    for number in range(1000, 1050):
        Path("p.toml").write_bytes(toml(drawn(number)))
        request = partial(RunRequest, "p.toml", "rig.toml", Path(f"run-{number}"))
        passed, started = passes(request), begins(request)
        assert passed == started == Path(f"run-{number}").exists(), drawn(number)
        begun += started
    assert 8 < begun < 42


@pytest.mark.parametrize(
    ("change", "row"),
    [
        ({"specimen": {"pattern": "no-such"}}, "pattern"),
        ({"specimen": {"pattern": "dense"}, "channels": ["image", "dots"]}, "pattern"),
        ({"depths_mm": [1.0, 1.001]}, "step names"),
        ({"indenters": ["sphere:2"], "depths_mm": [1.5]}, "simulated gel"),
    ],
)
def test_what_run_refuses_is_a_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, Any], row: str
) -> None:
    base = {"name": "x", "indenters": ["sphere:10"], "positions_mm": [[0.0, 0.0]],
            "depths_mm": [1.0], "channels": ["force"], "capture": {"settle_s": 0.1}}  # fmt: skip
    (tmp_path / "p.toml").write_bytes(toml({**base, **change}))
    (tmp_path / "rig.toml").write_bytes(toml(VIRTUAL))
    monkeypatch.chdir(tmp_path)
    failed = [r.name for r in RunRequest("p.toml", "rig.toml").checks() if r.failed]
    assert failed == [row]
