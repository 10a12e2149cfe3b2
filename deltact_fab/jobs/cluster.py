"""Where jobs run: processes here, or a Dask cluster whose workers have this process's code."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from ..errors import InputError, RunFailed
from ..extras import require
from . import messages
from .batch import CannotGoOn
from .local import local, processors, take_share

R = TypeVar("R")

LOCAL = "local"
DASK = "dask:"
CONNECT_S = 10.0
WORKERS_S = 10.0
GONE_S = 60.0  # a worker that died is often started again
PACKAGE = Path(__file__).parents[1]


@contextlib.contextmanager
def executor(on: str = LOCAL, workers: int | None = None) -> Iterator[Executor]:
    """An executor until the end of the block; then whatever still runs on it is ended.

    on: "local", or "dask:tcp://HOST:PORT" of an existing scheduler. workers: local processes, by
    default one for each processor that this process may use. Raises InputError for another `on`,
    and workers with a cluster; MissingLibrary without the extra `cluster`; RunFailed where no
    scheduler answers, it has no workers, or theirs is other code than this.
    """
    if on == LOCAL:
        with local(workers or processors()) as here:
            yield here
        return
    if not on.startswith(DASK):
        raise InputError(f"--on {on!r}: expected 'local' or 'dask:tcp://HOST:PORT'")
    if workers is not None:
        raise InputError(f"--jobs {workers}: with --on {on} the cluster says how many at a time")
    with cluster(on.removeprefix(DASK)) as there:
        yield there


@cache
def code() -> str:
    """The digest of the package's sources, as they are on this machine."""
    text = hashlib.sha256()
    for file in sorted(PACKAGE.rglob("*.py")):
        text.update(f"{file.relative_to(PACKAGE).as_posix()}\n".encode() + file.read_bytes())
    return text.hexdigest()[:16]


@contextlib.contextmanager
def cluster(address: str) -> Iterator[Cluster]:
    """The workers of the scheduler at tcp://HOST:PORT, until the end of the block.

    Raises InputError for another form of address, MissingLibrary without the extra `cluster`,
    RunFailed when no scheduler answers, no worker is there, or one has other code.
    """
    place = address.partition("://")
    if place[0] not in ("tcp", "tls") or not place[2].rpartition(":")[2].isdecimal():
        raise InputError(f"--on 'dask:{address}': expected dask:tcp://HOST:PORT")
    require("cluster", f"--on dask:{address}", "distributed")
    from distributed import Client

    with _quiet():
        try:
            client = Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError) as why:
            raise RunFailed(f"no Dask scheduler answers at {address}") from why
        with client:
            _require_same_code(client, address)
            client.subscribe_topic(messages.TOPIC, lambda event: messages.hear(tuple(event[1])))
            there = Cluster(client)
            try:
                yield there
            finally:
                there.shutdown(wait=False)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """What goes wrong is told by the error that ends it, and by no traceback of a library's."""
    names = [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    loggers = [logging.getLogger(name) for name in (*names, "tornado.application")]
    before = [one.level for one in loggers]
    for one in loggers:
        one.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for one, level in zip(loggers, before, strict=True):
            one.setLevel(level)


def _require_same_code(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError as why:
        raise RunFailed(f"the Dask scheduler at {address} has no workers") from why
    for worker, answer in client.run(code, on_error="return").items():
        if isinstance(answer, ImportError):
            raise RunFailed(f"Dask worker {worker}: cannot import deltact_fab ({answer})")
        if isinstance(answer, BaseException):
            raise RunFailed(f"Dask worker {worker}: {answer}")
        if answer != code():
            raise CannotGoOn(f"Dask worker {worker}: {_unlike(answer, code())}")


def _unlike(there: str, here: str) -> str:
    return f"its deltact_fab is another ({there}, here {here}): install the same on both"


class Cluster(Executor):
    """Dask's own executor; each job makes sure that its worker, which may be new, has our code."""

    def __init__(self, client: Any) -> None:
        # pure: a job that failed and is asked again is done again.
        self._client, self._inner = client, client.get_executor(pure=False)
        self.workers = sum(client.nthreads().values())
        self._seen_s = time.monotonic()

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """As every Executor's."""
        future: Future[R] = self._inner.submit(_checked, code(), fn, args, kwargs)
        return future

    def check(self) -> None:
        """While someone waits: raises CannotGoOn when there is nothing left to wait for."""
        now_s = time.monotonic()
        if self._client.status == "running" and self._client.scheduler_info()["workers"]:
            self._seen_s = now_s
        elif now_s - self._seen_s > GONE_S:
            raise CannotGoOn(f"the Dask cluster is gone: no worker for {GONE_S:g} s")

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As every Executor's; without wait, what runs is cancelled."""
        self._inner.shutdown(wait=wait and not cancel_futures)


def _checked(asked: str, fn: Callable[..., R], args: tuple[Any, ...], kwargs: dict[str, Any]) -> R:
    if code() != asked:
        raise CannotGoOn(f"a Dask worker that came later: {_unlike(code(), asked)}")
    take_share(1)
    return fn(*args, **kwargs)
