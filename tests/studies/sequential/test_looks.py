"""A run that ends when its goal is shown: its record, its resumes, its extension."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from called import called, started
from short_run import QUICK, ShortRun

from deltact_fab.bench.record.check import check_run
from deltact_fab.bench.record.journal import PRESS_TABLES, read_press_rows
from deltact_fab.bench.record.run import Run, open_run
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.analysis.force.calibrate import calibrate
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment
from deltact_fab.studies.sequential.looks import GoalLooks

# Twelve presses and four references; looks after 7, 13 and 16, the first at two places alone.
PROTOCOL = """
name = "until"
channels = ["image", "force"]
press = [
    {presses}
]
[reference]
every = 5
depth_mm = 0.4
"""
ROW = '{{{{indenter = "sphere:8", x_mm = {}, y_mm = {}, depth_mm = {}, role = "{}"}}}},'
PLACES = [(x, y) for y in (-2.1, 2.4) for x in (-4.0, -2.5, -0.9, 0.8, 2.4, 3.9)]
PRESSES = [
    ROW.format(x, y, 0.4 + 0.1 * (k % 3), "validate" if k % 2 else "fit")
    for k, (x, y) in enumerate(PLACES)
]
GOAL = "normal 2N"


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> ShortRun:
    folder = tmp_path_factory.mktemp("until")
    return ShortRun(folder, PROTOCOL.format(presses="\n    ".join(PRESSES)) + QUICK)


def carry_out(short: ShortRun, out: Path, goal: str | None = None, **how: Any) -> dict[str, Any]:
    """Run, resume or extend it as the command does."""
    extend, resume = how.get("extend"), bool(how.get("resume"))
    request = RunRequest(str(short.protocol), str(short.rig), out, seed=3)
    looks = GoalLooks.of_request(request, goal, extend, resume)  # type: ignore[arg-type]
    return run_experiment(request, resume=resume, early_end=looks)


@pytest.fixture(scope="module")
def ended(short: ShortRun) -> Path:
    """The run that ends at its goal."""
    out = short.folder / "ended"
    carry_out(short, out, GOAL)
    return out


def unfinished(folder: Path, out: Path, decisions: int, presses: int) -> Path:
    """A copy as a kill leaves it: with some decisions, and some of its presses."""
    shutil.copytree(folder, out)
    (out / "summary.json").unlink()
    names = [name for name, _ in complete(out)][presses:]
    with closing(sqlite3.connect(out / "journal.sqlite")) as db, db:
        for table in PRESS_TABLES:
            db.executemany(f"DELETE FROM {table} WHERE press = ?", [(name,) for name in names])
        query = "SELECT seq FROM events WHERE kind = 'decision' ORDER BY seq"
        later = db.execute(query).fetchall()[decisions:]
        db.executemany("DELETE FROM events WHERE seq = ?", later)
    return out


def complete(folder: Path) -> list[tuple[str, int]]:
    """Complete presses in order, with their numbers of frames."""
    frames = open_run(folder).frames()
    return list(frames.groupby("press", sort=False).size().items())  # type: ignore[arg-type]


def test_goal_ends_run_early(short: ShortRun, ended: Path) -> None:
    run = open_run(ended)
    first, second = run.decisions()
    assert (first["presses"], first["places"], first["level"], first["rms"]) == (7, 2, 0.0, None)
    assert first["reason"] == "2 places to validate, 4 needed"
    assert (second["presses"], second["places"], second["reached"]) == (13, 5, True)
    assert second["level"] == pytest.approx(0.05 * 5 / 6)
    assert 0 < second["rms"] < second["bound"] < 2
    summary = run.summary()
    names = [press["name"] for press in run.meta["presses"]]
    assert [name for name, _ in complete(ended)] == names[:13]
    assert summary["skipped"] == names[13:]
    assert summary["until"]["reached"]
    assert summary["until"]["looks"] == [first, second]
    assert summary["frames"] == len(run.frames()) == 39
    assert summary["steps"] == len(run.steps())
    (remark,) = (note for note in summary["remarks"] if note["id"] == "until")
    assert remark["text"].startswith(f"after 13 presses: normal {second['rms']:.3g} N, at most ")
    assert remark["text"].endswith(" N by 5 validation places; goal 2 N reached")


def test_ended_run_is_intact(ended: Path, tmp_path: Path) -> None:
    verdict = check_run(ended)
    assert verdict.intact
    assert verdict.whole_presses == verdict.presses == 13
    assert "13/13 presses complete, 3 presses and changes skipped, 39/39 frames" in verdict.line
    assert open_run(ended).count_presses() == (13, 16)
    assert len(open_run(ended).press_roles()) == 13
    # A press that the summary does not name as skipped is missing.
    data = json.loads((ended / "summary.json").read_text())
    copy = shutil.copytree(ended, tmp_path / "run")
    data["skipped"].pop()
    (copy / "summary.json").write_text(json.dumps(data))
    kinds = {(damage.kind, damage.where) for damage in check_run(copy).problems}
    assert ("missing", "sphere-8/ref4") in kinds


@pytest.mark.slow
def test_ended_run_is_calibrated(ended: Path) -> None:
    result = calibrate([ended], ["inverse-placed"])
    second = open_run(ended).decisions()[1]
    if result.gel is None and result.unrelaxed is None:
        found = result.validation["normal"].value
        assert found == pytest.approx(second["rms"], rel=0.05)
    assert result.validation["normal"].over == "5 distinct presses"
    assert result.reference is not None
    assert result.reference.over.startswith("3 presses")


@pytest.mark.parametrize(("decisions", "presses"), [(1, 7), (1, 9), (0, 7), (1, 13), (2, 13)])
def test_resume_makes_the_same_decisions(
    short: ShortRun, ended: Path, tmp_path: Path, decisions: int, presses: int
) -> None:
    out = unfinished(ended, tmp_path / "r", decisions, presses)
    summary = carry_out(short, out, resume=True)
    run, first = open_run(out), open_run(ended)
    assert run.decisions() == first.decisions()
    assert read_press_rows(out) == read_press_rows(ended)
    assert summary["skipped"] == first.summary()["skipped"]
    assert summary["until"] == first.summary()["until"]
    assert check_run(out).intact
    session = run.events().query("kind == 'session'").index[-1]
    moved = "homed" in set(run.events().loc[session:, "kind"])
    assert moved == (presses < 13)  # what is decided is not even homed for


@pytest.mark.slow
def test_killed_run_decides_the_same(short: ShortRun, ended: Path, tmp_path: Path) -> None:
    out = tmp_path / "r"
    words = [*short.words(out), "--until", GOAL]
    with started("-m", "deltact_fab", *words) as process:
        while not (out.exists() and _decisions(out)):
            assert process.poll() is None
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    assert not (out / "summary.json").exists()
    done = called(*words[:-2], "--resume")
    assert done.returncode == 0, done.stderr
    assert open_run(out).decisions() == open_run(ended).decisions()
    assert read_press_rows(out) == read_press_rows(ended)


def _decisions(folder: Path) -> int:
    with closing(sqlite3.connect(folder / "journal.sqlite")) as db:
        query = "SELECT count(*) FROM events WHERE kind = 'decision'"
        return int(db.execute(query).fetchone()[0])


def test_other_goal_is_refused_at_resume(short: ShortRun, ended: Path, tmp_path: Path) -> None:
    out = unfinished(ended, tmp_path / "r", 1, 8)
    with pytest.raises(InputError, match=r"until\.goal: 2\.0 in the folder, 1\.0 now"):
        carry_out(short, out, "normal 1N", resume=True)
    with closing(sqlite3.connect(out / "journal.sqlite")) as db, db:
        db.execute("UPDATE events SET text = '{\"presses\": 7}' WHERE kind = 'decision'")
    with pytest.raises(InputError, match=r"journal\.sqlite: decision: goal: missing key"):
        carry_out(short, out, resume=True)


def test_extension_makes_more_presses(short: ShortRun, ended: Path, tmp_path: Path) -> None:
    out = shutil.copytree(ended, tmp_path / "r")
    words = [*short.words(out), "--json"]
    refused = called(*words, "--extend", "4")
    assert refused.returncode == 2
    assert "its list has 3 presses more; give --extend 3" in refused.stderr
    done = called(*words, "--extend", "2")
    assert done.returncode == 0, done.stderr
    summary, run = json.loads(done.stdout), open_run(out)
    assert len(complete(out)) == 15
    *earlier, extension, last = run.decisions()
    assert earlier == open_run(ended).decisions()
    assert extension == {"extended_to": 15}
    assert (last["presses"], last["places"], last["spent"]) == (15, 6, 6)
    assert last["level"] == pytest.approx(0.05 / 6)
    assert summary["until"]["looks"] == [*earlier, last]
    assert len(summary["skipped"]) == 1
    assert check_run(out).intact
    # A kill within the extension: it goes on to its end, and decides the same.
    cut = unfinished(out, tmp_path / "cut", 3, 14)
    carry_out(short, cut, resume=True)
    assert open_run(cut).decisions() == run.decisions()
    assert read_press_rows(cut) == read_press_rows(out)
    refused = called(*words, "--extend", "1", "--resume")
    assert "--extend continues a finished run" in refused.stderr


def test_runs_that_cannot_be_extended(
    short: ShortRun, ended: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = unfinished(ended, tmp_path / "r", 1, 8)
    with pytest.raises(InputError, match="it has not finished; continue with --resume"):
        carry_out(short, out, extend=1)
    monkeypatch.setattr(Run, "count_presses", lambda run: (16, 16))
    with pytest.raises(InputError, match=r"all 16 .* second protocol, `run PROTOCOL --extends "):
        carry_out(short, ended, extend=1)
    meta = json.loads((out / "run.json").read_text())
    del meta["until"]
    (out / "run.json").write_text(json.dumps(meta))
    with pytest.raises(InputError, match="it has no goal of --until"):
        carry_out(short, out, extend=1)


def test_air_shows_no_goal(short: ShortRun, tmp_path: Path) -> None:
    words = [*short.words(tmp_path / "r"), "--until", GOAL, "--air"]
    assert "--until: not with --air, which presses nothing" in called(*words).stderr
    assert not (tmp_path / "r").exists()


Squares = Callable[[int], list[float]]


@pytest.mark.parametrize(
    ("squares", "reached", "says"),
    [
        (lambda n: [0.01] * n, [13, 16], "reached"),
        (lambda n: [9.0] * n, [], "its list has ended: go on with a second protocol, `run PROTO"),
        # Too many bad frames: no decision, and no level spent.
        (lambda n: [0.01] * (n - 2), [16], "reached"),
        (lambda n: [0.01 if n < 6 else 9.0] * n, [13], "it was reached after 13 presses"),
    ],
)
def test_decisions_by_errors(
    short: ShortRun, ended: Path, monkeypatch: pytest.MonkeyPatch, squares: Squares,
    reached: list[int], says: str,
) -> None:  # fmt: skip
    def validate(run: Run, presses: list[str]) -> dict[str, list[float]]:
        roles = run.meta["presses"][: len(presses)]
        return {"normal": squares(sum(row["role"] == "validate" for row in roles))}

    monkeypatch.setattr("deltact_fab.estimate.analysis.force.calibrate.validate_partly", validate)
    monkeypatch.setattr("deltact_fab.estimate.validate_partly", validate, raising=False)
    request = RunRequest(str(short.protocol), str(short.rig), ended)
    looks = GoalLooks.of_request(request, GOAL, None, resume=False)
    assert looks is not None
    names = [press.name for press in request.protocol.list_presses()]
    ends = [n for n in range(17) if looks(names[:n])[0]]
    assert ends == reached
    assert sum(look.level for look in looks.looks) <= 0.05 + 1e-12
    assert says in looks.remark().text
    assert [n for n in range(17) if looks(names[:n])[1]] == []  # each is journalled once


def test_second_protocol_names_first(short: ShortRun, ended: Path, tmp_path: Path) -> None:
    request = RunRequest(str(short.protocol), str(short.rig), tmp_path / "r", extends=ended)
    assert request.extends == ended
    other = tmp_path / "other.toml"
    other.write_text(short.protocol.read_text() + 'serial = "B"\n')
    done = called("run", other, "--rig", short.rig, "--out", tmp_path / "x", "--extends", ended)
    assert done.returncode == 2
    assert f"--extends: {ended}: specimen.serial: None, but 'B'" in done.stderr
    quick = tmp_path / "quick.toml"
    text = short.protocol.read_text()
    head, _, rest = text.partition("press = [")
    row = rest.strip().splitlines()[0]
    quick.write_text(f"{head}press = [{row}]\n[capture]{rest.partition('[capture]')[2]}")
    words = ["run", quick, "--rig", short.rig, "--out", tmp_path / "y"]
    done = called(*words, "--extends", ended)
    assert done.returncode == 0, done.stderr
    second = open_run(tmp_path / "y")
    assert second.meta["extends"] == open_run(ended).id
    (tmp_path / "y" / "summary.json").unlink()
    assert called(*words, "--resume").returncode == 0
