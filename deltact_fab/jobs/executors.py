"""Where jobs run: processes of this machine, or a Dask cluster that is there."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from ..errors import InputError
from .local import local, processors

LOCAL = "local"
DASK = "dask:"


@contextmanager
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
    from .cluster import cluster

    with cluster(on.removeprefix(DASK)) as there:
        yield there
