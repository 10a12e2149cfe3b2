"""Workers: the same answers, the first error, and nothing left when one dies or Ctrl-C comes."""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest

from deltact_fab.cad.export import parallel
from deltact_fab.errors import RunFailed

LISTED = pytest.mark.skipif(shutil.which("ps") is None, reason="ps is not installed (procps)")


def _no_children_left():
    return not multiprocessing.active_children()


@pytest.mark.parametrize("jobs", [1, 3])
def test_every_answer_comes_with_its_index(jobs):
    answers = {}
    parallel.run(math.sqrt, [4, 9, 16, 25], jobs, answers.__setitem__)
    assert answers == {0: 2, 1: 3, 2: 4, 3: 5}
    assert _no_children_left()


@pytest.mark.parametrize("jobs", [1, 2])
def test_the_first_task_that_fails_gives_the_error_however_late(jobs):
    # In two processes the third task fails at once, the second only after a while.
    tasks = ["1", "sum(range(10_000_000)) + one", "two", "3"]
    answers = {}
    with pytest.raises(NameError, match="'one'"):
        parallel.run(eval, tasks, jobs, answers.__setitem__)
    assert answers.keys() <= {0}
    assert _no_children_left()


def test_a_worker_that_dies_is_one_line():
    with pytest.raises(RunFailed, match="a worker process died") as why:
        parallel.run(os._exit, [3, 3, 3], 2, lambda index, answer: None)
    assert "\n" not in str(why.value)
    assert _no_children_left()


@pytest.mark.parametrize("way", ["file", "stdin"])
def test_a_script_without_a_guard_runs_once(tmp_path, way):
    text = (
        "import math\nfrom deltact_fab.cad.export import parallel\nprint('here')\n"
        "parallel.run(math.sqrt, [4, 9], 2, lambda index, answer: print(answer))\n"
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
def test_workers_die_with_their_parent():
    script = (
        "import time\nfrom deltact_fab.cad.export import parallel\n"
        "print('on', flush=True)\n"
        "parallel.run(time.sleep, [60, 60, 60], 2, print)\n"
    )
    with _group(script) as process:
        _wait(lambda: len(_members(process.pid)) >= 3)
        process.kill()
        process.wait()
        _wait(lambda: not _members(process.pid))


@LISTED
def test_ctrl_c_ends_the_workers_and_keeps_the_exception():
    # A shell starts what it puts in the background, this test perhaps, with Ctrl-C ignored.
    script = (
        "import signal, time\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from deltact_fab.cad.export import parallel\n"
        "try:\n    parallel.run(time.sleep, [60, 60, 60], 2, print)\n"
        "except KeyboardInterrupt:\n    print('stopped')\n"
    )
    with _group(script) as process:
        _wait(lambda: len(_members(process.pid)) >= 3)
        # As a terminal does it: to every process of the group.
        os.killpg(process.pid, signal.SIGINT)
        out, errors = process.communicate(timeout=20)
        assert (out, errors, process.returncode) == ("stopped\n", "", 0)
        _wait(lambda: not _members(process.pid))


@contextlib.contextmanager
def _group(script):
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


def _members(group):
    """Living processes of a process group."""
    listed = subprocess.run(
        ["ps", "-eo", "pid=,pgid=,stat="], capture_output=True, text=True, check=True
    ).stdout
    rows = [line.split() for line in listed.splitlines()]
    return [pid for pid, pgid, state in rows if int(pgid) == group and not state.startswith("Z")]


def _wait(true, limit_s=20):
    started = time.monotonic()
    while not true():
        assert time.monotonic() - started < limit_s
        time.sleep(0.05)
