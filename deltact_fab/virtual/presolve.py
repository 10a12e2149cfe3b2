"""All presses of a protocol solved ahead of a run, side by side, and kept.

Every press is kept when it is whole, so whatever ends this early loses at most the presses under
way; the next time goes on with those that are not in the store.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field

from ..errors import DeltactFabError
from ..gel.zones import Zones
from ..jobs import JobOutcome, run, tell
from ..protocols.plan import Protocol
from ..rig.config import GelConfig
from ..shapes import SkinDimensions
from .presses import PlannedPress, Presses, PressPath, path_of, stored_files


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


Told = Callable[[PressRow], None]


def solve_ahead(
    protocol: Protocol,
    skin: SkinDimensions,
    config: GelConfig,
    executor: Executor | None = None,
    told: Told | None = None,
) -> list[PressRow]:
    """Every press of a protocol, solved or found; a failure ends that press and no other.

    told: called with a press after each of its knots. executor: as of `jobs.run`.
    """
    presses = Presses(protocol, skin, config)
    told = told or (lambda row: None)
    rows: list[PressRow] = []
    todo: dict[str, PressRow] = {}
    given: list[_Press] = []
    waiting: list[tuple[PressRow, PressRow, PressPath]] = []
    for path in presses.paths:
        try:
            press = presses.of(path)
        except DeltactFabError as why:  # no mesh serves this one
            row = PressRow(path.press, 0, failure=" ".join(str(why).split()))
        else:
            row = _row(press)
            name = press.solver.stored_as or press.name
            if press.solver.found is None and name in todo:
                row.like = todo[name].press
                waiting.append((row, todo[name], path))
            elif press.solver.found is None:
                todo[name] = row
                given.append(_Press(protocol, skin, config, path.press, stored_files(press)))
        rows.append(row)
        if not row.like:
            told(row)
    solving = list(todo.values())
    ended: set[int] = set()

    def hear(index: int, knot: list[float]) -> None:
        row = solving[index]
        if index not in ended:  # what was said may come after the end
            row.done, row.seconds = int(knot[0]), row.seconds + knot[1]
            told(row)

    def heard(end: JobOutcome[PressRow]) -> None:
        row = solving[end.index]
        ended.add(end.index)
        if end.value is not None:
            vars(row).update(vars(end.value))
        elif isinstance(end.error, DeltactFabError):
            row.failure = " ".join(str(end.error).split())
        elif end.error is not None:
            raise end.error
        told(row)

    run(_one, given, heard, executor, told=hear)
    for row, solved, path in waiting:
        if solved.failure:
            row.failure = f"as {solved.press}, its mirror image: {solved.failure}"
        else:
            vars(row).update(vars(_row(presses.of(path))), like=solved.press, seconds=0.0)
        told(row)
    return rows


@dataclass(frozen=True)
class _Press:
    """A press to be solved; makes: files of the store that it may leave."""

    protocol: Protocol
    skin: SkinDimensions
    config: GelConfig
    name: str
    makes: tuple[str, ...]


def _one(job: _Press) -> PressRow:
    """One press, stored when complete; reports each knot."""
    started = time.perf_counter()
    presses = Presses(job.protocol, job.skin, job.config)
    press = presses.of(path_of(presses, job.name))
    failure = ""
    try:
        press.solver.solve_all(lambda done, of, seconds: tell([done, seconds]))
    except DeltactFabError as why:
        failure = " ".join(str(why).split())
    except (ArithmeticError, ValueError, MemoryError) as why:
        failure = f"{type(why).__name__}: {' '.join(str(why).split())}"
    row = _row(press)
    row.failure, row.found, row.seconds = failure, False, time.perf_counter() - started
    return row


def _row(press: PlannedPress) -> PressRow:
    return PressRow(
        press.name,
        len(press.solver.poses),
        done=len(press.solver.knots),
        found=press.solver.found is not None,
        seconds=press.solver.found["seconds"] if press.solver.found else 0.0,
        zones=press.solver.knots[-1].zones if press.solver.knots else Zones(),
        flags=press.solver.flags,
        failure=press.solver.ended,
    )
