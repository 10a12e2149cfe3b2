"""The harness itself, on a toy engine whose answers are known, and end to end on the real ones."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from deltact_fab.app.cli.numerics import numerics
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.studies.numerics import harness

TOY = """
import functools, os, time
from deltact_fab.common.cache import Store
from deltact_fab.common.errors import RunFailed
from deltact_fab.studies.numerics.engine import Case, CurveSetting, Engine, Flagged, Work

@functools.cache
def in_memory():
    burn(0.02)

def answer():
    in_memory()
    store = Store("toy")
    if store.read({"answer": 1}) is None:
        burn(0.02)
        store.write({"answer": 1}, "stored")

def burn(seconds):
    end_s = time.process_time() + seconds
    while time.process_time() < end_s:
        pass

def build(n, scratch):
    calls = []
    def run():
        if not calls:
            burn(0.15)
        calls.append(1)
        answer()
        print("noise on stdout")
        block = b"x" * (40_000_000 if n == 2 else 1)
        return len(block), os.environ["OMP_NUM_THREADS"], len(os.sched_getaffinity(0))
    return Work(run, lambda result: 1.0 / n if result[1:] == ("1", 1) else float("nan"))

def curves():
    return [CurveSetting("toy", "s", f"n = {n}", "mm", "the truth", 1e-9,
                    lambda scratch, n=n: build(n, scratch)) for n in (1, 2)]

def refuse(words, kind=RunFailed):
    raise kind(words)

def cases(quick):
    out = [
        Case("good", "right", lambda s: (-0.5, "a note"), 1.0, "mm"),
        Case("off", "right", lambda s: 2.0, 1.0, "mm"),
        Case("nan", "right", lambda s: float("nan"), 1.0, "mm"),
        Case("refuses", "refused", lambda s: refuse("too deep"), says="deep"),
        Case("flags", "right or refused", lambda s: refuse("flagged", Flagged), 1.0, says="flag"),
        Case("refuses for another reason", "refused", lambda s: refuse("no disk"), says="deep"),
        Case("answers what it should refuse", "refused", lambda s: 0.0, says="deep"),
        Case("refuses what it should answer", "right", lambda s: refuse("too deep"), 1.0),
        Case("crashes", "right or refused", lambda s: 1 / 0, 1.0),
    ]
    if not quick:
        out[1:] = [
            Case("takes the process down", "right", lambda s: os._exit(9), 1.0),
            Case("hangs", "right", lambda s: time.sleep(60), 1.0),
            Case("comes after", "right", lambda s: 0.0, 1.0),
        ]
    return out

ENGINE = Engine("Toy", "for the test", cases, curves)
"""


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "toy_engine.py").write_text(TOY)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "toy_engine", raising=False)
    monkeypatch.setitem(harness.ENGINE_MODULES, "toy", "toy_engine")
    monkeypatch.setenv("DELTACT_FAB_CACHE", str(tmp_path / "cache"))
    return "toy_engine"


@pytest.mark.slow
def test_crash_or_hang_is_wrong(toy: str, tmp_path: Path) -> None:
    cases = harness.load_engine(toy).cases(False)
    rows = list(harness.case_rows("toy", toy, cases, tmp_path, False, silence_s=5.0))
    assert [r["case"] for r in rows] == [c.name for c in cases]
    assert [r["outcome"] for r in rows] == ["right", "wrong", "wrong", "right"]
    assert "worker process died twice" in rows[1]["note"]
    assert "no answer for 5 s" in rows[2]["note"]


def test_a_setting_that_fails_is_named(toy: str, tmp_path: Path) -> None:
    setting, _ = harness.load_engine(toy).curves()
    wrong = type(setting)(**{**setting.__dict__, "name": "n = 0"})
    with pytest.raises(RunFailed, match=r"toy: toy \| s \| n = 0"):
        list(harness.curve_rows("toy", toy, [wrong], tmp_path, False))


def test_pareto_front() -> None:
    def row(
        case: str, cpu_s: float, error: float | None, kind: str = "exact"
    ) -> dict[str, Any]:  # fmt: skip
        # A setting that waited for the processor is not slower for it.
        return {"engine": "e", "case": case, "series": "s", "setting": "n", "cpu_s": cpu_s,
                "wall_s": 9 / cpu_s, "error": error, "kind": kind}  # fmt: skip

    rows = [row("a", 1, 4), row("a", 2, 2), row("a", 3, 3), row("a", 4, 1), row("a", 0.5, None),
            row("b", 9, 9), row("b", 1, 1, "finer self")]  # fmt: skip
    found = harness.compare_to_baseline(rows)
    # What is fast and right by itself alone is no front, and hides none.
    assert [r["pareto"] for r in found] == [True, True, False, True, False, True, False]
    assert [r["times_as_fast"] for r in found] == [1, 0.5, pytest.approx(1 / 3), 0.25, 2, 1, 9]
    assert {r["baseline"] for r in found} == {"s, n"}


def test_wrong_row_fails_the_command(toy: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = CliRunner().invoke(numerics, ["toy", "--quick", "--out", str(out)])
    assert done.exit_code == 1
    assert "wrong: toy: off: 2.0 over 1.0 mm" in done.stderr
    data = json.loads((out / "numerics.json").read_text())
    assert data["wrong"] == 6
    rows = {row["case"]: row for row in data["stability"]}
    assert {case: row["outcome"] for case, row in rows.items()} == {
        "good": "right", "off": "wrong", "nan": "wrong", "refuses": "refused", "flags": "flagged",
        "refuses for another reason": "wrong", "answers what it should refuse": "wrong",
        "refuses what it should answer": "wrong", "crashes": "wrong",
    }  # fmt: skip
    assert (rows["good"]["figure"], rows["good"]["note"]) == (-0.5, "a note")
    assert rows["nan"]["figure"] is None
    assert "ZeroDivisionError" in rows["crashes"]["note"]
    small, large = data["curves"]
    # The error is 1/n only where one thread on one core was given.
    assert (small["error"], large["error"]) == (1.0, 0.5)
    for row in (small, large):
        assert row["repeats"] >= 5
        assert row["compile_s"] > 0.12
        # Neither the store nor a function's memory answers a timed call.
        assert 0.04 <= row["cpu_s"] <= row["cpu_most_s"] < 0.14
    assert large["peak_mb"] > 35 > small["peak_mb"]
    page = (out / "numerics.html").read_text()
    assert (page.count('<tr class="bad">'), page.count("<svg")) == (6, 1)
    assert not re.search(r"""(src|href)=["'](http|//)|url\(http|@import""", page)
    header, *lines = (out / "curves.csv").read_text().splitlines()
    assert len(lines) == 2
    assert {"cpu_s", "compile_s", "peak_mb", "error", "reference_error"} <= {*header.split(",")}


def test_an_unknown_engine_is_exit_2() -> None:
    with pytest.raises(InputError, match="did you mean 'flow'"):
        harness.run_engines(["flows"])


@pytest.mark.parametrize(
    "quick",
    [pytest.param(True, marks=pytest.mark.slow), pytest.param(False, marks=pytest.mark.evidence)],
)
def test_everything_end_to_end(
    quick: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DELTACT_FAB_CACHE", str(tmp_path))
    found = harness.run_engines(quick=quick)
    assert found.wrong == []
    engines = {name: harness.load_engine(m) for name, m in harness.ENGINE_MODULES.items()}
    assert {r["engine"] for r in found.stability} == set(engines)
    timed = {name for name, engine in engines.items() if not (quick and engine.slow)}
    assert {r["engine"] for r in found.curves} == timed
    assert sum(r["anew"] for r in found.extremes) >= (1 if quick else 30)
