"""Checks of planned runs: promised beside reached, and deviations from the plan."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from deltact_fab.bench.protocols.plan import load_protocol
from deltact_fab.bench.record.run import open_run
from deltact_fab.present.report.page import plan_checks

PROMISE: dict[str, Any] = {
    "measure": "normal force", "unit": "N", "goal": 0.1, "error": 0.07, "interval": [0.05, 0.11],
    "chance": 0.86,
}  # fmt: skip


@pytest.fixture
def planned(mini_run: Path, tmp_path: Path) -> Path:
    """A copy of a run whose protocol has a promise."""
    out = tmp_path / "run"
    shutil.copytree(mini_run, out, ignore=shutil.ignore_patterns("images", "analysis"))
    digest = load_protocol(str(out / "protocol.toml"))[0].digest
    promise = PROMISE | {"digest": digest}
    lines = "".join(f"{key} = {json.dumps(value)}\n" for key, value in promise.items())
    with (out / "protocol.toml").open("a") as file:
        file.write(f"\n[promise]\n{lines}")
    meta = json.loads((out / "run.json").read_text())
    meta["protocol"]["promise"] = promise
    (out / "run.json").write_text(json.dumps(meta))
    return out


def rows(
    run: Path, validation: tuple[float, float | None, float | None] | None = None
) -> list[Any]:
    """Status and text of the checks, after a calibration with this error."""
    if validation is not None:
        (run / "analysis").mkdir()
        keys = ("value", "low", "high")
        normal = dict(zip(keys, validation, strict=True)) | {"over": "12 distinct presses"}
        text = json.dumps({"validation": {"normal": normal}})
        (run / "analysis" / "force.json").write_text(text)
    return [(check.status, str(check.value)) for check in plan_checks(open_run(run))]


def test_unplanned_run_has_no_check(mini_run: Path) -> None:
    assert rows(mini_run) == []


def test_promise_waits_for_a_calibration(planned: Path) -> None:
    ((status, text),) = rows(planned)
    assert status == "warn"
    assert text.startswith("Promised: normal force to 0.07 N [0.05 to 0.11], goal 0.1 N with")
    assert text.endswith("Reached: unknown; run `calibrate force`.")


@pytest.mark.parametrize(
    ("validation", "status", "end"),
    [
        ((0.08, 0.06, 0.09), "pass", "; the goal is shown."),
        ((0.08, 0.06, 0.12), "warn", "; the goal is met."),
        ((0.08, None, None), "warn", "; the goal is met."),
        ((0.105, 0.09, 0.12), "warn", "; the goal is missed."),
        ((0.2, 0.15, 0.3), "warn", "; the goal is missed, outside of what was promised."),
        ((0.02, 0.01, 0.03), "warn", "; the goal is shown, outside of what was promised."),
    ],
)
def test_reached_stands_beside_promised(
    validation: tuple[float, float | None, float | None], status: str, end: str, planned: Path
) -> None:
    ((found, text),) = rows(planned, validation)
    assert found == status
    assert f"Reached: {validation[0]:.2g} N" in text
    assert text.endswith(end)


def test_deviations_are_named(planned: Path) -> None:
    protocol = (planned / "protocol.toml").read_text()
    (planned / "protocol.toml").write_text(protocol.replace("depths_mm = [", "depths_mm = [0.05, "))
    summary = json.loads((planned / "summary.json").read_text())
    (planned / "summary.json").write_text(json.dumps(summary | {"skipped": ["sphere-10/p9"]}))
    texts = [text for _, text in rows(planned)]
    assert "The protocol was changed after it was planned." in texts
    assert "1 planned presses and changes were skipped." in texts
