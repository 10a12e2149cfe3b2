"""`study`: what is listed, refused, told, kept when it is ended, and gone on with."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import tiny_study
from click.testing import CliRunner

from deltact_fab.app.cli.main import main
from deltact_fab.app.cli.study import study
from deltact_fab.studies.study.grid import STUDY_STORE
from deltact_fab.studies.study.registry import STUDIES, Study

COMMAND = [sys.executable, str(Path(tiny_study.__file__)), "study", "run", "tiny"]


@pytest.fixture(autouse=True)
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("DELTACT_FAB_CACHE", str(tmp_path / "store"))
    (tmp_path / "done").mkdir()
    monkeypatch.setenv(tiny_study.DONE, str(tmp_path / "done"))
    return tmp_path / "store" / STUDY_STORE.kind


def call(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *words], capture_output=True, text=True, cwd=folder, timeout=300, check=False
    )


def files(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir()}


def test_studies_are_listed_with_options() -> None:
    listed = CliRunner().invoke(study, ["list"]).stdout
    for name, one in STUDIES.items():
        assert f"{name} " in listed
        assert one.line in listed
        shown = (
            CliRunner().invoke(main, ["study", "run", name, "--help"], terminal_width=200).stdout
        )
        flags = {"scale": "--scale", "seed": "--seed", "rig": "--rig", "from": "--from",
                 "grid": "--on"}  # fmt: skip
        assert {what for what, flag in flags.items() if f" {flag} " in shown} == set(one.takes)
        for flag in one.options:
            assert f"{flag} " in shown
        assert f"[default: study-out/{name}]" in shown


def test_study_options_are_typed(monkeypatch: pytest.MonkeyPatch) -> None:
    own = {"--few": {"help": "N.", "default": 3}, "--many": {"help": "M.", "multiple": True}}
    monkeypatch.setitem(STUDIES, "own", Study("none", "Own.", takes=("scale",), options=own))
    words = ["study", "run", "own", "--help"]
    shown = " ".join(CliRunner().invoke(main, words, terminal_width=120).stdout.split())
    assert "--few INTEGER N. [default: 3]" in shown
    assert "--many TEXT M." in shown
    told = CliRunner().invoke(study, ["run", "own", "--few", "x"])
    assert (told.exit_code, "--few" in told.output) == (2, True)
    told = CliRunner().invoke(study, ["run", "own", "--from", "run"])
    assert (told.exit_code, "No such option" in told.output) == (2, True)


@pytest.mark.slow
def test_refusal_is_one_line_without_output(tmp_path: Path) -> None:
    strange = tmp_path / "strange"
    strange.mkdir()
    (strange / "mine.txt").write_text("mine")
    for words, says in (
        (["--scale", "0.5"], "No such option"),
        (["--jobs", "0"], "Invalid value for '--jobs'"),
        (["--on", "cloud"], "--on 'cloud': expected 'local' or 'dask:tcp://HOST:PORT'"),
        (["--out", str(strange)], f"{strange}: "),
    ):
        told = call(tmp_path, *words)
        assert told.returncode == 2
        assert told.stderr.startswith(f"deltact-fab: {says}")
        assert told.stderr.count("\n") == 1
        assert told.stdout == ""
    assert not list((tmp_path / "done").iterdir())
    assert files(strange) == {"mine.txt": b"mine"}


@pytest.mark.slow
def test_study_reuses_its_own_folder(tmp_path: Path) -> None:
    first = call(tmp_path, "--count", "3", "--json", "--figures", "figures")
    assert first.returncode == 0, first.stderr
    assert len(json.loads(first.stdout)["tables"]["means"]) == 3
    assert "0 of 3 jobs stored, 3 to do\n" in first.stderr
    assert f"report: {Path('study-out/tiny/report.html')}\n" in first.stderr
    again = call(tmp_path, "--count", "4", "--fails", "job-3", "--partial", "yes")
    assert again.returncode == 0
    assert again.stdout == "3 means.\n1 job is missing, so nothing is decided.\n"
    assert "3 of 4 jobs stored, 1 to do" in again.stderr
    assert "failed: job-3: it did not converge\n" in again.stderr
    assert "warning: 1 jobs failed and are not included: job-3;" in again.stderr
    assert "job-3" in (tmp_path / "study-out/tiny/report.html").read_text()
    before = files(tmp_path / "study-out/tiny")
    failed = call(tmp_path, "--count", "4", "--fails", "job-3")
    assert failed.returncode == 1
    assert failed.stderr.splitlines()[-1] == (
        "deltact-fab: job-3: no result: it did not converge; other results are stored; run the "
        "same command to retry"
    )
    assert files(tmp_path / "study-out/tiny") == before


def begun(folder: Path, *words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*COMMAND, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder,
        start_new_session=True,
    )  # fmt: skip


def until(process: subprocess.Popen[str], store: Path, count: int) -> None:
    """Wait for so many kept results, or for the end."""
    started = time.monotonic()
    while process.poll() is None and len(list(store.glob("*.bin"))) < count:
        assert time.monotonic() - started < 120
        time.sleep(0.01)


@pytest.mark.slow
def test_ctrl_c_keeps_results_for_resume(tmp_path: Path, store: Path) -> None:
    with begun(tmp_path, "--seconds", "0.3", "--jobs", "2") as process:
        until(process, store, 2)
        os.killpg(process.pid, signal.SIGINT)
        out, said = process.communicate(timeout=60)
    kept = len(list(store.glob("*.bin")))
    assert (process.returncode, out) == (130, "")
    # Without a terminal a line every few seconds says how far it is.
    assert [line for line in said.splitlines() if not line.startswith("tiny: ")][1:] == [
        f"deltact-fab: stopped: {kept} of 12 jobs stored; run the same command to resume"
    ]
    assert 2 <= kept < 12
    assert not (tmp_path / "study-out/tiny/report.html").exists()


@pytest.mark.slow
def test_killed_and_resumed_tables_are_identical(
    tmp_path: Path, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = random.Random(22)
    asked = ("--count", "16", "--seconds", "0.1", "--jobs", "2", "--seed", "5")
    kills, kept = 0, [0]
    while kept[-1] < 14:
        with begun(tmp_path, *asked) as process:
            until(process, store, kept[-1] + drawn.randint(1, 3))
            time.sleep(drawn.uniform(0.0, 0.1))
            process.kill()  # it alone: its workers have to see by themselves that it is gone
            process.communicate(timeout=60)
        kills += 1
        kept.append(len(list(store.glob("*.bin"))))
        assert kept[-1] > kept[-2]
    assert kills >= 4
    done = len(list((tmp_path / "done").iterdir()))
    assert kept[-1] <= done <= kept[-1] + 2 * kills
    resumed = call(tmp_path, *asked)
    assert resumed.returncode == 0, resumed.stderr
    monkeypatch.setenv("DELTACT_FAB_CACHE", str(tmp_path / "other-store"))
    whole = call(tmp_path, *asked, "--out", "whole")
    assert whole.returncode == 0, whole.stderr
    assert resumed.stdout == whole.stdout
    tables = {"means.csv"}
    one, other = files(tmp_path / "study-out/tiny"), files(tmp_path / "whole")
    assert one.keys() == other.keys() > tables
    assert {n: one[n] for n in tables} == {n: other[n] for n in tables}
    held = [json.loads(each["result.json"])["tables"] for each in (one, other)]
    assert held[0] == held[1]
    assert len(held[0]["means"]) == 16
