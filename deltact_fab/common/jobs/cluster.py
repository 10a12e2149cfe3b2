"""Executors: local processes, or a Dask cluster whose workers have the same code."""

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
from typing import Any

from deltact_fab.paths import PACKAGE_DIR

from .. import cache
from ..errors import InputError, RunFailed, require_extra
from .batch import CannotGoOn
from .local import Local, Result, processors, set_processor_share

ON_LOCAL = "local"
DASK_ADDRESS = re.compile(r"dask:((?:tcp|tls)://.+:\d+)")
CONNECT_S = 10.0  # by hand: a slow network needs longer
WORKERS_S = 10.0  # by hand: workers may still be starting
NO_WORKER_S = 60.0  # by hand: a dead worker is often restarted
CLUSTER_CHECK_S = 1.0  # by hand: detection delay of a lost cluster
SEND_DELAY_S, JOBS_AHEAD = 0.01, 32  # by hand: larger batches, coarser sharing
CODE_BADGE = "deltact-fab"


@contextlib.contextmanager
def open_executor(
    on: str = ON_LOCAL, workers: int | None = None, threads: int | None = None
) -> Iterator[Local | Cluster]:
    """Open an executor for the block; jobs still running at its end are terminated.

    on: "local", or "dask:tcp://HOST:PORT" of an existing scheduler. workers: local processes, by
    default one per processor that this process may use. threads: as in `Local`.
    Raises InputError for another `on`, or for workers with a cluster; else as `cluster`.
    """
    if on == ON_LOCAL:
        with Local(workers or processors(), threads) as local:
            yield local
        return
    if not (match := DASK_ADDRESS.fullmatch(on)):
        raise InputError(f"--on {on!r}: expected 'local' or 'dask:tcp://HOST:PORT'")
    if workers is not None:
        raise InputError(f"--jobs {workers}: not with --on {on}: the cluster sets the number")
    with cluster(match[1]) as remote:
        yield remote


@functools.cache
def source_digest() -> str:
    """Digest of the package's sources on this machine."""
    text = hashlib.sha256()
    for file in sorted(PACKAGE_DIR.rglob("*.py")):
        text.update(f"{file.relative_to(PACKAGE_DIR).as_posix()}\n".encode() + file.read_bytes())
    return text.hexdigest()[:16]


@contextlib.contextmanager
def cluster(address: str) -> Iterator[Cluster]:
    """Connect to the workers of the scheduler at tcp://HOST:PORT for the block.

    Workers with other code get no jobs and are named on stderr. Raises MissingLibrary without the
    extra `cluster`, RunFailed if no scheduler answers or no worker has this code.
    """
    require_extra("cluster", f"--on dask:{address}", "distributed")
    from distributed import Client
    from distributed.utils import silence_logging_cmgr

    # Failures are reported by the final error. The handler is shared by all its loggers.
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
    """Plugin by which every worker, also later ones, offers its code digest as a resource.

    Jobs require the resource, so the scheduler sends none to workers with other code. The class is
    local, so that it is pickled by value, for workers with other code or without the package.
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
            # A worker that starts running makes the scheduler assign waiting jobs.
            worker.status = Status.paused
            worker.status = Status.running

    return Badge()


class Cluster(Executor):
    """Executor on workers with the same code; jobs are sent and fetched in batches.

    At most JOBS_AHEAD jobs per thread are sent in advance: so early jobs start first, new workers
    get a share, and a dying worker affects few. Store files travel along: `needs` of a job's last
    argument names files that are sent, once per cluster; files named in its `makes` are copied back
    when it has ended.
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

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> Future[Result]:
        """Like Executor.submit; a job cancelled after sending may still run, without effect."""
        future: Future[Result] = Future()
        self._waiting.append((future, (fn, args, kwargs)))
        if not self._send_scheduled:
            self._send_scheduled = True
            loop = self._client.loop
            loop.add_callback(loop.call_later, SEND_DELAY_S, self._send)
        return future

    def check(self) -> None:
        """Raise CannotGoOn if the cluster has had no worker for NO_WORKER_S."""
        now_s = time.monotonic()
        if now_s - self._checked_s < CLUSTER_CHECK_S:
            return
        self._checked_s = now_s
        if self._client.status == "running" and self._count_threads():
            self._alive_s = now_s
        elif now_s - self._alive_s > NO_WORKER_S:
            raise CannotGoOn(f"the Dask cluster is gone: no worker for {NO_WORKER_S:g} s")

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Like Executor.shutdown(wait=False); pending results are dropped."""
        for future, _ in self._waiting:
            future.cancel()

    def _count_threads(self) -> int:
        """Count the threads of workers with the same code; report each other worker once."""
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
        """Send as many jobs as fit; runs on the client's thread."""
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
        # pure=False: a failed job that is submitted again runs again.
        jobs = [job for _, job in batch]
        tasks = self._client.map(_work, jobs, files, pure=False, resources=resources)
        self._in_flight |= {task.key: pair[0] for task, pair in zip(tasks, batch, strict=True)}
        self._client.loop.add_callback(self._fetch, tasks)

    async def _fetch(self, tasks: list[Any]) -> None:
        from distributed import as_completed

        coming = as_completed(tasks, self._client.loop, with_results=True, raise_errors=False)
        tasks.clear()  # so the cluster releases fetched results
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
    """Store files that a job's last argument lists in `needs` or `makes`."""
    return getattr(job[1][-1], attribute, ()) if job[1] else ()


def _work(
    job: tuple[Callable[..., Result], tuple[Any, ...], dict[str, Any]], files: dict[str, bytes]
) -> tuple[Result, dict[str, bytes]]:
    set_processor_share(1)
    for name, data in files.items():
        cache.copy_in(name, data)
    fn, args, kwargs = job
    return fn(*args, **kwargs), cache.copy_out(_job_files(job, "makes"))
