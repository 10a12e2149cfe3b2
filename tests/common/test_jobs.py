"""Jobs on an executor: the same answers, the first error, and nothing left when something dies."""

from __future__ import annotations

import contextlib
import functools
import math
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from deltact_fab.common import jobs
from deltact_fab.common.errors import InputError, MissingLibrary, RunFailed
from deltact_fab.common.jobs.batch import run_each, run_jobs
from deltact_fab.common.jobs.cluster import open_executor
from deltact_fab.common.jobs.local import JOB_ATTEMPTS, THREAD_VARIABLES, processors

LISTED = pytest.mark.skipif(shutil.which("ps") is None, reason="ps is not installed (procps)")


def none_left() -> bool:
    return not multiprocessing.active_children()


@pytest.mark.parametrize("workers", [1, 3])
def test_results_and_progress_in_job_order(workers: int) -> None:
    heard: list[tuple[int, int, str]] = []
    names = ["four", "nine", "sixteen", "twenty-five"]
    assert run_each(
        math.sqrt, [4, 9, 16, 25], names,
        progress=lambda *told: heard.append(told), workers=workers,
    ) == [2, 3, 4, 5]  # fmt: skip
    assert [(done, of) for done, of, _ in heard] == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert sorted(name for *_, name in heard) == sorted(names)
    assert none_left()


def test_any_executor_will_do() -> None:
    with ThreadPoolExecutor(2) as threads:
        assert run_each(math.sqrt, [4, 9], ["a", "b"], threads) == [2, 3]
    with open_executor(workers=2) as own:
        assert own.workers == 2
        assert run_each(math.sqrt, [4, 9], ["a", "b"], own) == [2, 3]
        assert run_each(math.sqrt, [16], ["c"], own) == [4]
        assert list(own.map(math.sqrt, [25, 36])) == [5, 6]
        assert len(multiprocessing.active_children()) == 2
    assert none_left()


@pytest.mark.parametrize("workers", [1, 2])
def test_first_failing_job_gives_the_error(workers: int) -> None:
    # In two processes the third job fails at once, the second only after a while.
    tasks = ["1", "sum(range(10_000_000)) + one", "two", "3"]
    arrived: dict[int, Any] = {}
    with pytest.raises(NameError, match="'one'"):
        run_each(eval, tasks, tasks, on_result=arrived.__setitem__, workers=workers)
    assert arrived.keys() <= {0}
    assert none_left()


@pytest.mark.parametrize("workers", [1, 2])
def test_failures_are_collected_on_request(workers: int) -> None:
    ended: dict[int, tuple[Any, Exception | None]] = {}
    run_jobs(eval, ["1", "one", "1/0", "4"], lambda k, *e: ended.update({k: e}), workers=workers)
    assert [ended[i][0] for i in (0, 3)] == [1, 4]
    assert [type(ended[i][1]) for i in (1, 2)] == [NameError, ZeroDivisionError]


def test_failing_callback_leaves_no_process() -> None:
    def arrived(index: int, result: float) -> None:
        raise ArithmeticError("heard")

    with pytest.raises(ArithmeticError, match="heard"):
        run_each(time.sleep, [0.01, 60, 60], "abc", on_result=arrived, workers=2)
    assert none_left()


def first_time_dies(mark: str) -> str:
    """A job that is killed the first time it is tried."""
    try:
        os.close(os.open(mark, os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return "done"
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


@pytest.mark.slow
def test_job_of_killed_process_is_retried(tmp_path: Path) -> None:
    marks = [str(tmp_path / f"{n}") for n in range(5)]
    assert run_each(first_time_dies, marks, marks, workers=2) == ["done"] * 5
    assert none_left()


def test_job_killing_its_process_fails_alone() -> None:
    ended: dict[int, tuple[Any, Exception | None]] = {}
    tasks = ["2", "__import__('os')._exit(3)", "__import__('time').sleep(0.5) or 5", "7"]
    run_jobs(eval, tasks, lambda k, *e: ended.update({k: e}), workers=2)
    assert [ended[i][0] for i in (0, 2, 3)] == [2, 5, 7]
    why = ended[1][1]
    assert isinstance(why, RunFailed)
    assert str(why).startswith("worker process died twice (out of memory, or killed)")
    assert JOB_ATTEMPTS == 2
    assert "\n" not in str(why)


@pytest.mark.slow
def test_idle_process_death_costs_no_attempt() -> None:
    with open_executor(workers=1) as own:
        for _ in range(JOB_ATTEMPTS + 1):
            (process_id,) = run_each(eval, ["__import__('os').getpid()"], ["id"], own)
            os.kill(process_id, signal.SIGKILL)
            time.sleep(0.2)
        assert run_each(first_time_dies, [os.devnull], ["there already"], own) == ["done"]


def nothing() -> None:
    return None


def test_unpicklable_job_fails_alone() -> None:
    ended: dict[int, tuple[Any, Exception | None]] = {}
    made = [nothing, lambda: None]
    run_jobs(functools.partial(isinstance, object), made, lambda k, *e: ended.update({k: e}),
             workers=2)  # fmt: skip
    assert isinstance(ended[0][1], TypeError)
    assert "local object" in str(ended[1][1])


def threads_of(_: int) -> tuple[list[str | None], int, int]:
    import cv2

    found = [os.environ.get(name) for name in THREAD_VARIABLES]
    return found, cv2.getNumThreads(), processors()


@pytest.mark.slow
@pytest.mark.parametrize("asked", [None, "5"])
def test_workers_share_processors_by_default(
    monkeypatch: pytest.MonkeyPatch, asked: str | None
) -> None:
    for name in THREAD_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    if asked is not None:
        monkeypatch.setenv("OMP_NUM_THREADS", asked)
    monkeypatch.setattr(jobs.local, "processors", lambda: 6)
    for found, of_cv2, inside in run_each(threads_of, [0, 1], ["a", "b"], workers=2):
        assert found[0] == asked or found == ["3"] * len(THREAD_VARIABLES)
        assert asked or (of_cv2, inside) == (3, 3)


def test_worker_keeps_users_thread_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ["OMP_NUM_THREADS", "MKL_NUM_THREADS"]
    monkeypatch.setenv(names[0], "5")
    monkeypatch.delenv(names[1], raising=False)
    monkeypatch.setattr(jobs.local, "processors", lambda: 3)
    with open_executor(workers=1) as workers:
        assert run_each(os.getenv, names, names, workers) == ["5", "3"]


@pytest.mark.parametrize(
    ("on", "workers", "says"),
    [
        ("cloud", None, "--on 'cloud': expected 'local' or 'dask:tcp://HOST:PORT'"),
        ("dask:tcp://127.0.0.1", None, "expected 'local' or 'dask:tcp://HOST:PORT'"),
        ("dask:127.0.0.1:8786", None, "expected 'local' or 'dask:tcp://HOST:PORT'"),
        ("dask:tcp://127.0.0.1:8786", 3, "--jobs 3: not with --on"),
    ],
)
def test_another_place_is_refused(on: str, workers: int | None, says: str) -> None:
    with pytest.raises(InputError) as why, open_executor(on, workers):
        pass
    assert says in str(why.value)


def test_missing_extra_names_install_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(MissingLibrary, match=r"pip install 'deltact-fab\[cluster\]'"),
        open_executor("dask:tcp://127.0.0.1:8786"),
    ):
        pass


# -- the caller ------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", ["file", "stdin"])
def test_script_without_guard_runs_once(tmp_path: Path, way: str) -> None:
    text = (
        "import math\nfrom deltact_fab.common import run_each\nprint('here')\n"
        "print(*run_each(math.sqrt, [4, 9], 'ab', workers=2), sep='\\n')\n"
    )
    script = tmp_path / "script.py"
    script.write_text(text)
    done = subprocess.run(
        [sys.executable, str(script) if way == "file" else "-"],
        input=text,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert sorted(done.stdout.split()) == ["2.0", "3.0", "here"]


@LISTED
@pytest.mark.parametrize("way", ["killed", "Ctrl-C"])
def test_workers_end_with_parent_or_interrupt(way: str) -> None:
    script = (
        "import time\n"
        "from deltact_fab.common import run_each\n"
        "try:\n    run_each(time.sleep, [60, 60, 60], 'abc', workers=2)\n"
        "except KeyboardInterrupt:\n    print('stopped')\n"
    )
    with group(script) as process:
        wait(lambda: len(members(process.pid)) >= 3)
        if way == "killed":
            process.kill()
            process.wait()
        else:  # as a terminal does it: to every process of the group
            os.killpg(process.pid, signal.SIGINT)
            out, errors = process.communicate(timeout=20)
            assert (out, errors, process.returncode) == ("stopped\n", "", 0)
        wait(lambda: not members(process.pid))


@contextlib.contextmanager
def group(script: str) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, "-c", script],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            yield process
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def members(of_group: int) -> list[str]:
    """Living processes of a process group."""
    listed = subprocess.run(
        ["ps", "-eo", "pid=,pgid=,stat="], capture_output=True, text=True, check=True
    ).stdout
    rows = [line.split() for line in listed.splitlines()]
    return [pid for pid, pgid, state in rows if int(pgid) == of_group and state[0] != "Z"]


def wait(true: Callable[[], bool], limit_s: float = 20) -> None:
    started = time.monotonic()
    while not true():
        assert time.monotonic() - started < limit_s
        time.sleep(0.05)
