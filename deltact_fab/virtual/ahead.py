"""All presses of a protocol solved ahead of a run, in processes of their own, and kept.

Every press is kept when it is whole, so whatever ends this early loses at most the presses under
way; the next time goes on with those that are not in the store.
"""

from __future__ import annotations

import os
import queue
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from typing import Any

from ..errors import DeltactFabError
from ..protocols.plan import Protocol
from ..rig.simulator import GelConfig
from ..shapes import SkinDimensions
from .press import Press
from .presses import Presses, path_of

POLL_S = 0.2
THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass
class Row:
    """What came of one press. seconds: of the knots' solves; found: it was in the store.

    like: the press whose solution serves this one too. between_mm, between_n: largest error of
    linear interpolation at the intervals tried, forces for the specimen's modulus. flags: of the
    solver, with the number of knots. failure: why it did not get through, else empty.
    """

    press: str
    knots: int
    done: int = 0
    found: bool = False
    like: str = ""
    seconds: float = 0.0
    between_mm: float = 0.0
    between_n: float = 0.0
    flags: dict[str, int] = field(default_factory=dict)
    failure: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)


Told = Callable[[Row], None]


def solve_ahead(
    protocol: Protocol,
    skin: SkinDimensions,
    config: GelConfig,
    jobs: int = 1,
    told: Told | None = None,
) -> list[Row]:
    """Every press of a protocol, solved or found; a failure ends that press and no other.

    told: hears of a press after each of its knots. jobs: processes at a time; 1: this one.
    """
    presses = Presses(protocol, skin, config)
    told = told or (lambda row: None)
    rows: list[Row] = []
    todo: dict[str, Row] = {}
    waiting: list[tuple[Row, Row]] = []
    for path in presses.paths:
        try:
            press = presses.of(path)
        except DeltactFabError as why:  # no mesh serves this one
            row = Row(path.press, 0, failure=" ".join(str(why).split()))
        else:
            row = _row(press, presses.modulus_mpa)
            name = press.solver.stored_as or press.name
            if press.solver.found is None and name in todo:
                row.like = todo[name].press
                waiting.append((row, todo[name]))
            elif press.solver.found is None:
                todo[name] = row
        rows.append(row)
        if not row.like:
            told(row)
    if jobs == 1:
        for row in todo.values():
            _here(protocol, skin, config, row, told)
    elif todo:
        _in_processes(protocol, skin, config, min(jobs, len(todo)), list(todo.values()), told)
    for row, solved in waiting:
        if solved.failure:
            row.failure = f"as {solved.press}, its mirror image: {solved.failure}"
        else:
            served = {"press": row.press, "like": solved.press, "found": True, "seconds": 0.0}
            vars(row).update(vars(solved), **served)
        told(row)
    return rows


def _here(
    protocol: Protocol, skin: SkinDimensions, config: GelConfig, row: Row, told: Told
) -> None:
    def hear(done: int, of: int, seconds: float) -> None:
        row.done, row.seconds = done, row.seconds + seconds
        told(row)

    vars(row).update(vars(_solved(protocol, skin, config, row.press, hear)))
    told(row)


def _in_processes(
    protocol: Protocol,
    skin: SkinDimensions,
    config: GelConfig,
    jobs: int,
    todo: list[Row],
    told: Told,
) -> None:
    context = get_context("spawn")
    with _few_threads(max(1, (os.cpu_count() or 1) // jobs)), context.Manager() as manager:
        news = manager.Queue()
        pool = ProcessPoolExecutor(jobs, mp_context=context)
        try:
            by_name = {row.press: row for row in todo}
            running: dict[Future[Row], Row] = {
                pool.submit(_one, protocol, skin, config, row.press, news): row for row in todo
            }
            while running:
                _hear(news, by_name, told)
                for future in [f for f in running if f.done()]:
                    row = running.pop(future)
                    _hear(news, by_name, told)
                    try:
                        vars(row).update(vars(future.result()))
                    except BrokenProcessPool:
                        row.failure = "its process was killed"
                    told(row)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _hear(news: Any, rows: dict[str, Row], told: Told) -> None:
    """Take what the processes said; waits POLL_S for the first word."""
    wait_s = POLL_S
    while True:
        try:
            name, done, seconds = news.get(timeout=wait_s)
        except queue.Empty:
            return
        rows[name].done, rows[name].seconds = done, rows[name].seconds + seconds
        told(rows[name])
        wait_s = 0.001


def _one(protocol: Protocol, skin: SkinDimensions, config: GelConfig, name: str, news: Any) -> Row:
    """One press, in a process of its own."""
    return _solved(
        protocol, skin, config, name, lambda done, of, seconds: news.put((name, done, seconds))
    )


def _solved(
    protocol: Protocol,
    skin: SkinDimensions,
    config: GelConfig,
    name: str,
    hear: Callable[[int, int, float], None],
) -> Row:
    started = time.perf_counter()
    presses = Presses(protocol, skin, config)
    press = presses.of(path_of(presses, name))
    failure = ""
    try:
        press.solver.solve_all(hear)
    except DeltactFabError as why:
        failure = " ".join(str(why).split())
    except (ArithmeticError, ValueError, MemoryError) as why:
        failure = f"{type(why).__name__}: {' '.join(str(why).split())}"
    row = _row(press, presses.modulus_mpa)
    row.failure, row.found, row.seconds = failure, False, time.perf_counter() - started
    return row


def _row(press: Press, modulus_mpa: float) -> Row:
    return Row(
        press.name,
        len(press.solver.poses),
        done=len(press.solver.knots),
        found=press.solver.found is not None,
        seconds=press.solver.found.seconds if press.solver.found else 0.0,
        between_mm=press.solver.between.displacement_mm,
        between_n=modulus_mpa * press.solver.between.force_n,
        flags=press.solver.flags,
        failure=press.solver.ended,
    )


@contextmanager
def _few_threads(number: int) -> Iterator[None]:
    """Processes started meanwhile share the cores instead of fighting for them."""
    before = {name: os.environ.get(name) for name in THREADS}
    for name in THREADS:
        os.environ.setdefault(name, str(number))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
