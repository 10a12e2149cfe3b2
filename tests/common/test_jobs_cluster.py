"""An existing Dask cluster as the executor: a real scheduler and its workers on loopback."""

from __future__ import annotations

import contextlib
import importlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from deltact_fab.common import cache, jobs
from deltact_fab.common.errors import RunFailed
from deltact_fab.common.jobs.batch import CannotGoOn, run_each, run_jobs
from deltact_fab.common.jobs.cluster import open_executor
from deltact_fab.studies.study.grid import GridJob, solve

pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
pytestmark = pytest.mark.slow

PROCESS = "__import__('time').sleep(0.2) or __import__('os').getpid()"
TINY = Path(__file__).parents[1] / "studies" / "study" / "tiny_study.py"
DASK = [sys.executable, "-m", "dask"]
LOOPBACK = ["--host", "127.0.0.1", "--no-dashboard"]


class Cluster:
    """A scheduler and workers of one thread each, on free ports."""

    def __init__(self, folder: Path, stack: contextlib.ExitStack) -> None:
        self.folder, self._stack = folder, stack
        self.file = folder / "scheduler.json"
        self.scheduler = self._start("scheduler", "--port", "0", *LOOPBACK)
        wait(self.file.exists)
        self.address: str = wait(lambda: json.loads(self.file.read_text() or "{}").get("address"))
        self.on = f"dask:{self.address}"
        self.workers: list[subprocess.Popen[bytes]] = []

    def add(self, count: int = 1, nanny: bool = False, path: str = "") -> None:
        """More workers; path: where they find modules first."""
        self.workers += [
            self._start("worker", "--nthreads", "1", *LOOPBACK, *([] if nanny else ["--no-nanny"]),
                        path=path)
            for _ in range(count)
        ]  # fmt: skip

    def _start(self, *words: str, path: str = "") -> subprocess.Popen[bytes]:
        store = self.folder / f"store-of-{words[0]}-{len(list(self.folder.iterdir()))}"
        paths = [path, str(TINY.parent), *sys.path]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)),
                       cache.FOLDER_VARIABLE: str(store)}  # fmt: skip
        with (store.with_suffix(".log")).open("ab") as log:
            process = subprocess.Popen(
                [*DASK, *words, "--scheduler-file", str(self.file)],
                stdout=log, stderr=log, env=environment, cwd=self.folder, start_new_session=True,
            )  # fmt: skip
        self._stack.callback(self._end, process)
        return process

    @staticmethod
    def _end(process: subprocess.Popen[bytes]) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cluster]:
    # A worker may begin late on a busy machine.
    monkeypatch.setattr(
        importlib.import_module("deltact_fab.common.jobs.cluster"), "WORKERS_S", 60.0
    )
    with contextlib.ExitStack() as stack:
        yield Cluster(tmp_path, stack)


def wait(true: Callable[[], Any], limit_s: float = 60) -> Any:
    started = time.monotonic()
    while not (found := true()):
        assert time.monotonic() - started < limit_s
        time.sleep(0.05)
    return found


def test_results_and_errors_come_from_there(cluster: Cluster) -> None:
    cluster.add(2)
    ended: dict[int, tuple[Any, Exception | None]] = {}
    with open_executor(cluster.on) as there:
        wait(lambda: len(there._client.nthreads()) == 2)  # type: ignore[attr-defined]
        assert run_each(math.sqrt, [4, 9, 16], "abc", there) == [2, 3, 4]
        run_jobs(
            eval, ["3", "1/0", "__import__('os').getpid()"],
            lambda k, *e: ended.update({k: e}), there,
        )  # fmt: skip
        assert [type(ended[i][1]) for i in range(3)] == [
            type(None), ZeroDivisionError, type(None)
        ]  # fmt: skip
        assert ended[0][0] == 3
        assert ended[2][0] != os.getpid()
        with pytest.raises(NameError, match="'one'"):
            run_each(eval, ["1", "one", "two"], "abc", there)
    with open_executor(cluster.on) as again:  # the first left it as it was
        assert run_each(math.sqrt, [4], "a", again) == [2]


def test_job_killing_its_workers_fails_alone(cluster: Cluster) -> None:
    cluster.add(nanny=True)  # one worker: each time it dies Dask blames those that wait on it too
    ended: dict[int, tuple[Any, Exception | None]] = {}
    with open_executor(cluster.on) as there:
        run_jobs(
            eval, ["__import__('os')._exit(3)", "7", "8"], lambda k, *e: ended.update({k: e}),
            there,
        )  # fmt: skip
    assert [ended[i][1] or ended[i][0] for i in (1, 2)] == [7, 8]
    assert isinstance(ended[0][1], RunFailed)
    assert str(ended[0][1]).startswith("every worker that tried it died")


@pytest.mark.parametrize("gone", ["scheduler", "workers"])
def test_lost_cluster_is_reported(
    cluster: Cluster, monkeypatch: pytest.MonkeyPatch, gone: str
) -> None:
    module = importlib.import_module("deltact_fab.common.jobs.cluster")
    monkeypatch.setattr(module, "NO_WORKER_S", 3.0)
    cluster.add(1)
    kill = f"__import__('os').killpg({cluster.scheduler.pid}, 9) or __import__('time').sleep(60)"
    task = {"scheduler": kill, "workers": "__import__('os')._exit(3)"}[gone]
    with pytest.raises(CannotGoOn, match="is gone"), open_executor(cluster.on) as there:
        run_jobs(eval, [task], print, there)


@pytest.mark.parametrize("way", ["nobody", "no workers"])
def test_missing_scheduler_is_reported(
    cluster: Cluster, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = importlib.import_module("deltact_fab.common.jobs.cluster")
    monkeypatch.setattr(module, "CONNECT_S", 2.0)
    monkeypatch.setattr(module, "WORKERS_S", 2.0)
    if way == "nobody":
        cluster._end(cluster.scheduler)
    says = {"nobody": "no Dask scheduler answers at", "no workers": "has no workers"}[way]
    with pytest.raises(RunFailed, match=says) as why, open_executor(cluster.on):
        pass
    assert cluster.address in str(why.value)
    assert "\n" not in str(why.value)


def test_worker_with_other_code_is_refused(
    cluster: Cluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    package = Path(jobs.__file__).parents[2]
    other = tmp_path / "other"
    (other / "deltact_fab").mkdir(parents=True)
    for file in (*package.glob("*.py"), *(package / "jobs").glob("*.py")):
        copy = other / file.relative_to(package.parent)
        copy.parent.mkdir(exist_ok=True)
        copy.write_bytes(file.read_bytes())
    said = "its deltact_fab differs"
    cluster.add(1)
    with open_executor(cluster.on) as there:
        assert there.workers == 1
        cluster.add(1, path=str(other))
        wait(lambda: len(there._client.nthreads()) == 2)
        ids = run_each(eval, [PROCESS] * 20, [str(n) for n in range(20)], there)
        wait(lambda: there.check() or said in capsys.readouterr().err)
    assert set(ids) == {cluster.workers[0].pid}
    with open_executor(cluster.on) as there:  # with both there from the start
        assert said in capsys.readouterr().err
        # One that comes later and is ours takes the jobs that wait when the first has died.
        os.killpg(cluster.workers[0].pid, signal.SIGKILL)
        cluster.add(1)
        assert run_each(eval, [PROCESS], ["a"], there) == [cluster.workers[2].pid]
        os.killpg(cluster.workers[2].pid, signal.SIGKILL)
        wait(lambda: len(there._client.nthreads()) == 1)
    with (
        pytest.raises(RunFailed, match=r"no worker at tcp://.* has this deltact_fab"),
        open_executor(cluster.on),
    ):
        pass


def test_store_files_travel_with_jobs(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of machines that share no disk: what one has made is here, and there where it is needed."""
    monkeypatch.setenv(cache.FOLDER_VARIABLE, str(tmp_path / "here"))
    monkeypatch.syspath_prepend(str(TINY.parent))
    tiny = importlib.import_module("tiny_study")
    cluster.add(2)
    file = "gel/one.bin"
    with open_executor(cluster.on) as there:
        wait(lambda: there._count_threads() == 2)
        (made,) = run_each(tiny.leave, [tiny.Leaves(file=file)], ["makes"], there)
        assert (tmp_path / "here" / file).read_text() == str(made["by"]) == str(made["in"])
        more = {f"job {n}": GridJob(f"job {n}", tiny.leave, {"file": file, "n": n, "s": 0.3},
                                    needs=(file, "gel/none.bin")) for n in range(8)}  # fmt: skip
        found = solve(list(more.values()), there).results
    assert {one["by"] for one in found.values()} == {made["by"]}
    assert len({one["in"] for one in found.values()}) == 2
