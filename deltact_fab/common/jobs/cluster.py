"""Where jobs run: processes here, or a Dask cluster whose workers have this process's code."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
import re
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from typing import Any, TypeVar

from deltact_fab.paths import PACKAGE_DIR

from .. import cache
from ..errors import InputError, RunFailed, require_extra
from .batch import CannotGoOn
from .local import Local, processors, take_share

R = TypeVar("R")

ON_LOCAL = "local"
DASK_ADDRESS = re.compile(r"dask:((?:tcp|tls)://.+:\d+)")
CONNECT_S = 10.0
WORKERS_S = 10.0
NO_WORKER_S = 60.0  # a worker that died is often started again
CLUSTER_CHECK_S = 1.0
SEND_DELAY_S, JOBS_AHEAD = 0.01, 32
CODE_BADGE = "deltact-fab"


@contextlib.contextmanager
def open_executor(
    on: str = ON_LOCAL, workers: int | None = None, threads: int | None = None
) -> Iterator[Local | Cluster]:
    """Open an executor until the end of the block; then whatever still runs on it is ended.

    on: "local", or "dask:tcp://HOST:PORT" of an existing scheduler. workers: local processes, by
    default one for each processor that this process may use. threads: as of `Local`.
    Raises InputError for another `on`, and workers with a cluster; else as `cluster`.
    """
    if on == ON_LOCAL:
        with Local(workers or processors(), threads) as local:
            yield local
        return
    if not (match := DASK_ADDRESS.fullmatch(on)):
        raise InputError(f"--on {on!r}: expected 'local' or 'dask:tcp://HOST:PORT'")
    if workers is not None:
        raise InputError(f"--jobs {workers}: with --on {on} the cluster says how many at a time")
    with cluster(match[1]) as remote:
        yield remote


@functools.cache
def source_digest() -> str:
    """The digest of the package's sources, as they are on this machine."""
    text = hashlib.sha256()
    for file in sorted(PACKAGE_DIR.rglob("*.py")):
        text.update(f"{file.relative_to(PACKAGE_DIR).as_posix()}\n".encode() + file.read_bytes())
    return text.hexdigest()[:16]


@contextlib.contextmanager
def cluster(address: str) -> Iterator[Cluster]:
    """The workers of the scheduler at tcp://HOST:PORT, until the end of the block.

    A worker with other code gets no job, whenever it comes; a line on stderr names it. Raises
    MissingLibrary without the extra `cluster`, RunFailed when no scheduler answers, or no worker
    with this code is there.
    """
    require_extra("cluster", f"--on dask:{address}", "distributed")
    from distributed import Client
    from distributed.utils import silence_logging_cmgr

    # What goes wrong is told by the error that ends it. The handler is all its loggers'.
    with silence_logging_cmgr(logging.CRITICAL):
        try:
            client = Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError) as error:
            raise RunFailed(f"no Dask scheduler answers at {address}") from error
        with client:
            try:
                client.wait_for_workers(1, timeout=WORKERS_S)
            except TimeoutError as error:
                raise RunFailed(f"the Dask scheduler at {address} has no workers") from error
            client.register_plugin(_badge_plugin())
            executor = Cluster(client)
            if not executor.workers:
                raise RunFailed(f"no worker at {address} has this deltact_fab ({source_digest()})")
            try:
                yield executor
            finally:
                executor.shutdown(wait=False)


def _badge_plugin() -> Any:
    """What makes every worker, those that come later too, show its code as a resource.

    A job asks for the resource, so that the scheduler gives it to no worker with other code. Of a
    class that is defined here it is pickled whole, for workers with other code or without.
    """
    from distributed import Status, WorkerPlugin

    class Badge(WorkerPlugin):
        name, idempotent = CODE_BADGE, True

        async def setup(self, worker: Any) -> None:
            try:
                from . import cluster

                digest = cluster.source_digest()
            except Exception as error:
                digest = f"none: {error}"
            await worker.set_resources(**{f"{self.name} {digest}": 1e9})
            # The scheduler looks for jobs that wait for a worker when one begins to run.
            worker.status = Status.paused
            worker.status = Status.running

    return Badge()


class Cluster(Executor):
    """Jobs for the workers that have our code, sent and fetched many at a time.

    What is sent ahead is AHEAD jobs for each of their threads: so the first are the first begun, a
    worker that comes later gets its share, and one that dies is blamed for few. Files of the store
    go with them: a job whose last argument has `needs`, names of such files, finds those that are
    here, sent to the cluster once; what it names in `makes` is here when it has ended.
    """

    def __init__(self, client: Any) -> None:
        self._client = client
        self._waiting: deque[tuple[Future[Any], tuple[Any, ...]]] = deque()
        self._in_flight: dict[str, Future[Any]] = {}
        self._files: dict[str, Any] = {}
        self._send_scheduled = False
        self._refused: set[str] = set()
        self._checked_s = self._alive_s = time.monotonic()
        self.workers = 0
        self._count_threads()

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """As every Executor's; what is cancelled when it has been sent may run, unheard."""
        future: Future[R] = Future()
        self._waiting.append((future, (fn, args, kwargs)))
        if not self._send_scheduled:
            self._send_scheduled = True
            loop = self._client.loop
            loop.add_callback(loop.call_later, SEND_DELAY_S, self._send)
        return future

    def check(self) -> None:
        """While someone waits: raises CannotGoOn when there is nothing left to wait for."""
        now_s = time.monotonic()
        if now_s - self._checked_s < CLUSTER_CHECK_S:
            return
        self._checked_s = now_s
        if self._client.status == "running" and self._count_threads():
            self._alive_s = now_s
        elif now_s - self._alive_s > NO_WORKER_S:
            raise CannotGoOn(f"the Dask cluster is gone: no worker for {NO_WORKER_S:g} s")

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As every Executor's, but that it never waits: what has not come back is forgotten."""
        for future, _ in self._waiting:
            future.cancel()

    def _count_threads(self) -> int:
        """Threads of the workers with our code; a line for each other one, once."""
        self.workers = 0
        for name, worker in self._client.scheduler_info()["workers"].items():
            badges = [r for r in worker["resources"] if r.startswith(CODE_BADGE)]
            if f"{CODE_BADGE} {source_digest()}" in badges:
                self.workers += worker["nthreads"]
            elif badges and name not in self._refused:
                self._refused.add(name)
                worker_code = badges[0].removeprefix(f"{CODE_BADGE} ")
                print(
                    f"Dask worker {name} gets no job: its deltact_fab differs ({worker_code}, here "
                    f"{source_digest()}): install the same version on both",
                    file=sys.stderr,
                )
        return self.workers

    def _send(self) -> None:
        """On the client's thread: as many jobs as there is room for."""
        self._send_scheduled = False
        room = JOBS_AHEAD * max(self.workers, 1) - len(self._in_flight)
        batch: list[tuple[Future[Any], tuple[Any, ...]]] = []
        while self._waiting and len(batch) < room:
            future, job = self._waiting.popleft()
            if not future.cancelled():
                batch.append((future, job))
        if not batch:
            return
        resources = {f"{CODE_BADGE} {source_digest()}": 1}
        files = []
        for _, job in batch:
            needs = _job_files(job, "needs")
            for name, data in cache.copy_out(set(needs) - self._files.keys()).items():
                self._files[name] = self._client.submit(bytes, data, resources=resources)
            files.append({name: self._files[name] for name in needs if name in self._files})
        # pure: a job that failed and is asked again is done again.
        jobs = [job for _, job in batch]
        tasks = self._client.map(_work, jobs, files, pure=False, resources=resources)
        self._in_flight |= {task.key: pair[0] for task, pair in zip(tasks, batch, strict=True)}
        self._client.loop.add_callback(self._fetch, tasks)

    async def _fetch(self, tasks: list[Any]) -> None:
        from distributed import as_completed

        coming = as_completed(tasks, self._client.loop, with_results=True, raise_errors=False)
        tasks.clear()  # so that the cluster keeps no result that has come
        async for task, value in coming:
            future = self._in_flight.pop(task.key)
            if isinstance(value, CancelledError):
                future.cancel()
            if future.set_running_or_notify_cancel():
                if task.status == "error":
                    future.set_exception(value[1])
                else:
                    for name, data in value[1].items():
                        cache.copy_in(name, data)
                    future.set_result(value[0])
            if 2 * len(self._in_flight) <= JOBS_AHEAD * self.workers:
                self._send()


def _job_files(job: tuple[Any, ...], attribute: str) -> tuple[str, ...]:
    """What a job's last argument says that it needs or makes, files of the store."""
    return getattr(job[1][-1], attribute, ()) if job[1] else ()


def _work(
    job: tuple[Callable[..., R], tuple[Any, ...], dict[str, Any]], files: dict[str, bytes]
) -> tuple[R, dict[str, bytes]]:
    take_share(1)
    for name, data in files.items():
        cache.copy_in(name, data)
    fn, args, kwargs = job
    return fn(*args, **kwargs), cache.copy_out(_job_files(job, "makes"))
