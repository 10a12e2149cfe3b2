"""Whatever is wrong with what a command reads, it ends with one line and leaves nothing behind."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from called import called
from wrong_input import LIMIT_S, TINY, VIRTUAL, Fuzz, fault, limited, stop_at_first_motion, toml

from deltact_fab.estimate.analysis.tracking_error.follow import analyse_tracking
from deltact_fab.present.report import study_page
from deltact_fab.present.report.result import Headline, StudyResult
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

Cases = Callable[[range], Counter[str]]


@pytest.fixture
def cases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cases:
    """Carries out cases by their numbers and counts how they ended; fails with what is wrong."""
    protocol, rig = tmp_path / "tiny.toml", tmp_path / "rig.toml"
    protocol.write_bytes(toml(TINY))
    rig.write_bytes(toml(VIRTUAL))
    run_experiment(RunRequest(str(protocol), str(rig), tmp_path / "run", seed=3))
    analyse_tracking(tmp_path / "run", ["dis-fast"]).save(tmp_path / "run" / "analysis")
    headline = Headline("error", 0.3, "mm", 0.2, 0.4, "5 seeds")
    study = StudyResult("s", "S", True, 3, 0.1, headlines=(headline,), settings={"a": "b"})
    (tmp_path / "result.json").write_bytes(study_page.contents(study)["result.json"])
    stop_at_first_motion(monkeypatch.setattr)

    def carried_out(numbers: range) -> Counter[str]:
        wrong, ends = [], Counter[str]()
        fuzz = Fuzz(tmp_path / "run", light=len(numbers) < 1000)
        for number in numbers:
            folder = tmp_path / str(number)
            what, words = fuzz.prepare(number, folder)
            monkeypatch.chdir(folder)
            with limited(LIMIT_S):
                done = called(*words)
            problem = fault(done.returncode, done.stderr, folder)
            ends[str(done.returncode)] += 1
            if problem:
                wrong.append(f"{number}: {what}: {' '.join(words)[:80]}: {problem}")
            monkeypatch.chdir(tmp_path)
            shutil.rmtree(folder)
        assert not wrong, f"{len(wrong)} of {len(numbers)}:\n" + "\n".join(wrong[:20])
        print(f"{len(numbers)} inputs, exit codes {dict(sorted(ends.items()))}")
        return ends

    return carried_out


@pytest.mark.slow
def test_wrong_input_is_one_line(cases: Cases) -> None:
    ends = cases(range(150))
    assert ends["2"] > 75
    assert ends["0"] > 3  # legal ones among them: what is drawn is not wrong beyond all measure


@pytest.mark.evidence
def test_a_thousand_wrong_inputs(cases: Cases) -> None:
    assert cases(range(1000, 2000))["2"] > 600
