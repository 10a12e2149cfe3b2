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

from deltact_fab.paths import PACKAGE

from .. import cache
from ..errors import InputError, RunFailed, require_extra
from .batch import CannotGoOn
from .local import Local, processors, take_share

R = TypeVar("R")

LOCAL = "local"
DASK = re.compile(r"dask:((?:tcp|tls)://.+:\d+)")
CONNECT_S = 10.0
WORKERS_S = 10.0
GONE_S = 60.0  # a worker that died is often started again
LOOK_S = 1.0
SEND_S, AHEAD = 0.01, 32
BADGE = "deltact-fab"


@contextlib.contextmanager
def open_executor(
    on: str = LOCAL, workers: int | None = None, threads: int | None = None
) -> Iterator[Local | Cluster]:
    """Open an executor until the end of the block; then whatever still runs on it is ended.

    on: "local", or "dask:tcp://HOST:PORT" of an existing scheduler. workers: local processes, by
    default one for each processor that this process may use. threads: as of `Local`.
    Raises InputError for another `on`, and workers with a cluster; else as `cluster`.
    """
    if on == LOCAL:
        with Local(workers or processors(), threads) as here:
            yield here
        return
    if not (known := DASK.fullmatch(on)):
        raise InputError(f"--on {on!r}: expected 'local' or 'dask:tcp://HOST:PORT'")
    if workers is not None:
        raise InputError(f"--jobs {workers}: with --on {on} the cluster says how many at a time")
    with cluster(known[1]) as there:
        yield there


@functools.cache
def code() -> str:
    """The digest of the package's sources, as they are on this machine."""
    text = hashlib.sha256()
    for file in sorted(PACKAGE.rglob("*.py")):
        text.update(f"{file.relative_to(PACKAGE).as_posix()}\n".encode() + file.read_bytes())
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
        except (OSError, TimeoutError) as why:
            raise RunFailed(f"no Dask scheduler answers at {address}") from why
        with client:
            try:
                client.wait_for_workers(1, timeout=WORKERS_S)
            except TimeoutError as why:
                raise RunFailed(f"the Dask scheduler at {address} has no workers") from why
            client.register_plugin(_badge())
            there = Cluster(client)
            if not there.workers:
                raise RunFailed(f"no worker at {address} has this deltact_fab ({code()})")
            try:
                yield there
            finally:
                there.shutdown(wait=False)


def _badge() -> Any:
    """What makes every worker, those that come later too, show its code as a resource.

    A job asks for the resource, so that the scheduler gives it to no worker with other code. Of a
    class that is defined here it is pickled whole, for workers with other code or without.
    """
    from distributed import Status, WorkerPlugin

    class Badge(WorkerPlugin):
        name, idempotent = BADGE, True

        async def setup(self, worker: Any) -> None:
            try:
                from . import cluster

                shown = cluster.code()
            except Exception as why:
                shown = f"none: {why}"
            await worker.set_resources(**{f"{self.name} {shown}": 1e9})
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
        self._away: dict[str, Future[Any]] = {}
        self._files: dict[str, Any] = {}
        self._called = False
        self._refused: set[str] = set()
        self._looked_s = self._seen_s = time.monotonic()
        self.workers = 0
        self._look()

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """As every Executor's; what is cancelled when it has been sent may run, unheard."""
        future: Future[R] = Future()
        self._waiting.append((future, (fn, args, kwargs)))
        if not self._called:
            self._called = True
            loop = self._client.loop
            loop.add_callback(loop.call_later, SEND_S, self._send)
        return future

    def check(self) -> None:
        """While someone waits: raises CannotGoOn when there is nothing left to wait for."""
        now_s = time.monotonic()
        if now_s - self._looked_s < LOOK_S:
            return
        self._looked_s = now_s
        if self._client.status == "running" and self._look():
            self._seen_s = now_s
        elif now_s - self._seen_s > GONE_S:
            raise CannotGoOn(f"the Dask cluster is gone: no worker for {GONE_S:g} s")

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As every Executor's, but that it never waits: what has not come back is forgotten."""
        for future, _ in self._waiting:
            future.cancel()

    def _look(self) -> int:
        """Threads of the workers with our code; a line for each other one, once."""
        self.workers = 0
        for name, worker in self._client.scheduler_info()["workers"].items():
            shown = [r for r in worker["resources"] if r.startswith(BADGE)]
            if f"{BADGE} {code()}" in shown:
                self.workers += worker["nthreads"]
            elif shown and name not in self._refused:
                self._refused.add(name)
                there = shown[0].removeprefix(f"{BADGE} ")
                print(
                    f"Dask worker {name} gets no job: its deltact_fab is another ({there}, here "
                    f"{code()}): install the same on both",
                    file=sys.stderr,
                )
        return self.workers

    def _send(self) -> None:
        """On the client's thread: as many jobs as there is room for."""
        self._called = False
        room = AHEAD * max(self.workers, 1) - len(self._away)
        batch: list[tuple[Future[Any], tuple[Any, ...]]] = []
        while self._waiting and len(batch) < room:
            future, job = self._waiting.popleft()
            if not future.cancelled():
                batch.append((future, job))
        if not batch:
            return
        ours = {f"{BADGE} {code()}": 1}
        files = []
        for _, job in batch:
            needs = _names(job, "needs")
            for name, data in cache.copy_out(set(needs) - self._files.keys()).items():
                self._files[name] = self._client.submit(bytes, data, resources=ours)
            files.append({name: self._files[name] for name in needs if name in self._files})
        # pure: a job that failed and is asked again is done again.
        sent = self._client.map(_work, [job for _, job in batch], files, pure=False, resources=ours)
        self._away |= {one.key: future for one, (future, _) in zip(sent, batch, strict=True)}
        self._client.loop.add_callback(self._fetch, sent)

    async def _fetch(self, sent: list[Any]) -> None:
        from distributed import as_completed

        coming = as_completed(sent, self._client.loop, with_results=True, raise_errors=False)
        sent.clear()  # so that the cluster keeps no result that has come
        async for one, value in coming:
            future = self._away.pop(one.key)
            if isinstance(value, CancelledError):
                future.cancel()
            if future.set_running_or_notify_cancel():
                if one.status == "error":
                    future.set_exception(value[1])
                else:
                    for name, data in value[1].items():
                        cache.copy_in(name, data)
                    future.set_result(value[0])
            if 2 * len(self._away) <= AHEAD * self.workers:
                self._send()


def _names(job: tuple[Any, ...], which: str) -> tuple[str, ...]:
    """What a job's last argument says that it needs or makes, files of the store."""
    return getattr(job[1][-1], which, ()) if job[1] else ()


def _work(
    job: tuple[Callable[..., R], tuple[Any, ...], dict[str, Any]], files: dict[str, bytes]
) -> tuple[R, dict[str, bytes]]:
    take_share(1)
    for name, data in files.items():
        cache.copy_in(name, data)
    fn, args, kwargs = job
    return fn(*args, **kwargs), cache.copy_out(_names(job, "makes"))
