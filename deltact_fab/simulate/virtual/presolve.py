"""All presses of protocols solved ahead of a run or a study, side by side, and kept.

Every press is kept when it is whole, so whatever ends this early loses at most the presses under
way; the next time goes on with those that are not in the store.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from concurrent.futures import Executor
from dataclasses import dataclass, field

from deltact_fab.bench import GelConfig, Protocol
from deltact_fab.common import DeltactFabError, Progress, run_jobs
from deltact_fab.physics import Zones
from deltact_fab.sensor import SkinDimensions

from .presses import PlannedPress, Presses, PressPath


@dataclass
class PressRow:
    """The outcome of one press. seconds: of the knots' solves; found: it was in the store.

    like: the press whose solution serves this one too. zones: of the contact at its end. flags: of
    the solver, with the number of knots. failure: why it did not get through, else empty.
    """

    press: str
    knots: int
    done: int = 0
    found: bool = False
    like: str = ""
    seconds: float = 0.0
    zones: Zones = field(default_factory=Zones)
    flags: dict[str, int] = field(default_factory=dict)
    failure: str = ""


def solve_presses(
    protocols: Iterable[Protocol],
    skin: SkinDimensions,
    config: GelConfig,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> list[PressRow]:
    """Solve every press of protocols or find it solved; a failure ends that press and no other.

    progress: told of each press at its end. executor: as of `jobs.run`.
    """
    planned = [
        (protocol, presses, path)
        for protocol in protocols
        for presses in (Presses(protocol, skin, config),)
        for path in presses.paths
    ]
    rows: list[PressRow] = []
    todo: dict[str, PressRow] = {}
    jobs: list[_Press] = []
    waiting: list[tuple[PressRow, PressRow, Presses, PressPath]] = []
    finished: list[str] = []

    def finish_row(row: PressRow) -> None:
        finished.append(row.press)
        if progress is not None:
            progress(len(finished), len(planned), row.press)

    for protocol, presses, path in planned:
        try:
            press = presses.planned_press(path)
        except DeltactFabError as failure:  # no mesh serves this one
            rows.append(PressRow(path.press, 0, failure=" ".join(str(failure).split())))
            finish_row(rows[-1])
            continue
        row = _press_row(press)
        rows.append(row)
        name = press.solver.stored_as or f"{press.name} of {protocol.name}"
        if press.solver.stored is not None:
            finish_row(row)
        elif name in todo:
            row.like = todo[name].press
            waiting.append((row, todo[name], presses, path))
        else:
            todo[name] = row
            jobs.append(_Press(protocol, skin, config, path.press, press.stored_files))
    solving = list(todo.values())

    def report_result(index: int, value: PressRow | None, error: Exception | None) -> None:
        row = solving[index]
        if value is not None:
            vars(row).update(vars(value))
        elif isinstance(error, DeltactFabError):
            row.failure = " ".join(str(error).split())
        elif error is not None:
            raise error
        finish_row(row)

    run_jobs(_solve_press, jobs, report_result, executor)
    for row, source, presses, path in waiting:
        if source.failure:
            row.failure = f"as {source.press}, its mirror image: {source.failure}"
        else:
            mirror = vars(_press_row(presses.planned_press(path)))
            vars(row).update(mirror, like=source.press, seconds=0.0)
        finish_row(row)
    return rows


@dataclass(frozen=True)
class _Press:
    """A press to be solved; makes: files of the store that it may leave."""

    protocol: Protocol
    skin: SkinDimensions
    config: GelConfig
    name: str
    makes: tuple[str, ...]


def _solve_press(job: _Press) -> PressRow:
    """One press, stored when complete."""
    started = time.perf_counter()
    presses = Presses(job.protocol, job.skin, job.config)
    press = presses.planned_press(presses.path(job.name))
    failure = ""
    try:
        press.solver.solve_all()
    except DeltactFabError as error:
        failure = " ".join(str(error).split())
    except (ArithmeticError, ValueError, MemoryError) as error:
        failure = f"{type(error).__name__}: {' '.join(str(error).split())}"
    row = _press_row(press)
    row.failure, row.found, row.seconds = failure, False, time.perf_counter() - started
    return row


def _press_row(press: PlannedPress) -> PressRow:
    return PressRow(
        press.name,
        len(press.solver.poses),
        done=len(press.solver.knots),
        found=press.solver.stored is not None,
        seconds=press.solver.stored["seconds"] if press.solver.stored else 0.0,
        zones=press.solver.knots[-1].zones if press.solver.knots else Zones(),
        flags=press.solver.flags,
        failure=press.solver.ended,
    )
