"""A planned session as its user has it: plan, run twice killed, calibrate, report, try."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from deltact_fab.app.cli.main import main
from deltact_fab.common.errors import Stopped
from deltact_fab.simulate import RunRequest, run_experiment
from deltact_fab.studies.plan import candidates, force


def command(*words: object) -> str:
    """Run a command in this process; its output."""
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.output


class _StopsAfter:
    """Progress that stops a run after some frames, as Ctrl-C does."""

    def __init__(self, calls: int) -> None:
        self.calls = calls

    def __call__(self, *state: object) -> None:
        self.calls -= 1
        if self.calls < 0:
            raise KeyboardInterrupt


@pytest.mark.slow
def test_planned_session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candidates, "FIT_PLACES", 4)
    for module in (candidates, force):
        monkeypatch.setattr(module, "VALIDATION_PLACES", 4)
    plan, run = tmp_path / "night.toml", tmp_path / "night"
    tip = ("--tip", "sphere:10", "--range", "4N", "--goal", "0.5N", "--time", "1h")
    text = command("protocol", "plan", "force", *tip, "--unattended", "-o", plan)
    presses = int(re.search(r"; (\d+) presses in random order", text)[1])
    assert presses >= 10
    for calls in (20, 60):
        with pytest.raises((KeyboardInterrupt, Stopped)):
            run_experiment(
                RunRequest(str(plan), "virtual", run, 1, progress=_StopsAfter(calls)),
                resume=calls > 20,
            )
    command("run", plan, "--seed", 1, "--out", run, "--resume")
    command("calibrate", "force", run)
    page = tmp_path / "night.html"
    command("report", run, "-o", page)
    html = page.read_text()
    promised = re.search(r"Promised: normal force to [0-9.]+ N .* Reached: ([0-9.]+) N", html)
    assert promised
    assert 0 < float(promised[1]) < 0.5
    assert "The protocol was changed" not in html
