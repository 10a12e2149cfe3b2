"""Printing for people and for programs: tables, JSON, how far a command has come."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from itertools import zip_longest
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

import click

from ..errors import MissingLibrary, RunFailed
from ..files import write_whole
from ..units import DIGITS, digits, duration
from .options import JSON

if TYPE_CHECKING:
    from ..aliases import Progress

LINE_EVERY_S = 5.0
"""Where no terminal shows a bar: a line so often, when there is something new to say."""
STILL_EVERY_S = 30.0
"""A line so often when there is not."""
LONG_S, LONG_LINE_EVERY_S = 600.0, 60.0
"""What takes longer than that says so once a minute."""
_NARROWEST = 12
_GAP = "  "


def echo_json(data: Any) -> None:
    """Print plain data as JSON; NaN is refused, for no JSON reader takes it."""
    click.echo(json.dumps(data, indent=1, allow_nan=False))


@dataclass(frozen=True)
class Answer:
    """What a command found.

    data: for a program, without NaN; lines: for a reader; asides: on stderr, after either. failed:
    why the exit code is 1, empty where the lines say it; None for a command that succeeded.
    """

    data: Any
    lines: Iterable[str] = ()
    failed: str | None = None
    asides: Iterable[str] = ()


def answers(command: Callable[..., Answer]) -> Callable[..., None]:
    """Gives a command `--json`, and prints what it returns."""

    @wraps(command)
    def told(as_json: bool, **given: Any) -> None:
        found = command(**given)
        if as_json:
            echo_json(found.data)
        else:
            for line in found.lines:
                click.echo(line)
        for line in found.asides:
            click.echo(line, err=True)
        if found.failed is not None:
            raise RunFailed(found.failed) if found.failed else click.exceptions.Exit(1)

    return JSON(told)


def written(file: Path, then: str = "") -> Answer:
    """Says which file was written and, if it is to be changed, what to run then."""
    told = f"{file}: written; change it, then `deltact-fab {then}`" if then else f"written: {file}"
    return Answer({"file": str(file)}, [told])


def files_line(files: Iterable[Path]) -> str:
    """The last line of a command that writes several files."""
    return f"written: {', '.join(map(str, files))}"


def listed(columns: Sequence[str], rows: Sequence[Sequence[Any]], *more: str) -> Answer:
    """A list, for a program an object a row by the same columns; more: lines below its table."""
    data = [dict(zip(columns, row, strict=True)) for row in rows]
    return Answer(data, [*table(columns, rows), *more])


def judged(name: str, done: Any, right: str, *more: str) -> Answer:
    """A verdict, then its rows (`patterns.verify.JudgedRow`): those of done.rows."""
    failed = [row.check for row in done.rows if not row.passed]
    rows = [
        (r.check, r.found, r.limit, "pass" if r.passed else "FAIL", "" if r.passed else r.advice)
        for r in done.rows
    ]
    verdict = f"{name}: {'fails: ' + ', '.join(failed) if failed else right}"
    lines = [verdict, "", *table(("check", "found", "limit", "", "what to do"), rows), *more]
    return Answer(done.as_dict(), lines, failed="" if failed else None)


def table(columns: Sequence[str], rows: Sequence[Sequence[Any]], names: int = 1) -> Iterator[str]:
    """The lines of rows under their columns, numbers to the right.

    On a terminal that is too narrow text is wrapped, and columns that still do not fit follow
    below; each part repeats the first `names` columns. Elsewhere a row is always one line.
    """
    right = [bool(rows) and all(_is_number(row[i]) for row in rows) for i in range(len(columns))]
    cells = [_column([row[i] for row in rows]) for i in range(len(columns))]
    whole = [max(map(len, (c, *column))) for c, column in zip(columns, cells, strict=True)]
    most = shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
    for k, part in enumerate(_parts(whole, right, names, most)):
        if k:
            yield ""
        widths = _narrowed(whole, right, part, most)
        for row in [columns, *zip(*cells, strict=True)]:
            wrapped = [
                textwrap.wrap(row[i], widths[i]) or [""] if len(row[i]) > widths[i] else [row[i]]
                for i in part
            ]
            for words in zip_longest(*wrapped, fillvalue=""):
                placed = [
                    word.rjust(widths[i]) if right[i] else word.ljust(widths[i])
                    for word, i in zip(words, part, strict=True)
                ]
                yield _GAP.join(placed).rstrip()


def _parts(widths: list[int], right: list[bool], names: int, most: int) -> list[list[int]]:
    """Columns by number, as they stand beside each other."""
    least = [w if r else min(w, _NARROWEST) for w, r in zip(widths, right, strict=True)]
    first, parts = list(range(min(names, len(widths)))), []
    part = first.copy()
    for i in range(len(first), len(widths)):
        if part != first and sum(least[j] + len(_GAP) for j in (*part, i)) - len(_GAP) > most:
            parts.append(part)
            part = first.copy()
        part.append(i)
    return [*parts, part]


def _narrowed(
    widths: list[int], right: list[bool], part: Sequence[int], most: int
) -> dict[int, int]:
    """Widths of the columns of a part, the widest text narrowed until all fit, if they can."""
    found = {i: widths[i] for i in part}
    while sum(found.values()) + len(_GAP) * (len(part) - 1) > most:
        wide = [i for i in part if not right[i] and found[i] > _NARROWEST]
        if not wide:
            break
        found[max(wide, key=found.__getitem__)] -= 1
    return found


def _column(values: Sequence[Any]) -> list[str]:
    """The cells of a column; floats of like size get as many decimals, so that points align."""
    numbers = [abs(v) for v in values if isinstance(v, int | float) and math.isfinite(v) and v]
    largest = max(numbers, default=0.0)
    # What cancelled is none.
    some = [n for n in numbers if n > 1e-9 * largest]
    alike = all(map(_is_number, values))
    if alike and some and min(some) >= 1e-4 and largest < 1e3 * min(some):
        decimals = max(0, DIGITS - 1 - math.floor(math.log10(largest)))
        cells = [f"{v:.{decimals}f}" if isinstance(v, float) else _cell(v) for v in values]
        while decimals and all(
            c.endswith("0") for c, v in zip(cells, values, strict=True) if isinstance(v, float)
        ):
            decimals -= 1
            cells = [f"{v:.{decimals}f}" if isinstance(v, float) else _cell(v) for v in values]
        return cells
    return [
        "0" if isinstance(v, float) and 0 < abs(v) <= 1e-9 * largest else _cell(v) for v in values
    ]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | None) and not isinstance(value, bool)


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return digits(value)
    if isinstance(value, list | tuple):
        return ", ".join(map(_cell, value)) or "none"
    return str(value)


def save_figures(folder: Path, drawn: Callable[[], Mapping[str, Any]]) -> list[Path]:
    """Write figures as NAME.svg and return the files; say so where there is no matplotlib.

    drawn: makes them, by name; None is nothing to draw. Raises RunFailed when the disk refuses.
    """
    files = []
    try:
        from ..report.figures import as_bytes

        for name, figure in drawn().items():
            if figure is not None:
                write_whole(folder / f"{name}.svg", as_bytes(figure, "svg"))
                files.append(folder / f"{name}.svg")
    except MissingLibrary as why:
        click.echo(f"no figures: {why}", err=True)
    return files


@contextmanager
def progress(title: str) -> Iterator[Progress]:
    """Tell on stderr how far a command has come: a bar on a terminal, elsewhere a line at times.

    A command that ends within LINE_EVERY_S writes no line.
    """
    if not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        with _in_lines(title) as tick:
            yield tick
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    with Progress(
        TextColumn(f"{title:<22}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[what]}", markup=False),
        console=Console(stderr=True),
    ) as bar:
        task = bar.add_task(title, total=None, what="")
        yield lambda done, total, what: bar.update(task, completed=done, total=total, what=what)


@contextmanager
def _in_lines(title: str) -> Iterator[Progress]:
    begun_s = time.monotonic()
    ended = Event()
    state, told = "working", ""
    told_s = begun_s

    def tick(done: int, total: int, what: str) -> None:
        nonlocal state
        state = f"{done} of {total}" + (f", {what}" if what else "")

    def say() -> None:
        nonlocal told, told_s
        told, told_s = state, time.monotonic()
        click.echo(f"{title}: {duration(time.monotonic() - begun_s)}: {told}", err=True)

    def talk() -> None:
        # Ctrl-C is for the main thread, which holds it back at times.
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        every_s = LINE_EVERY_S
        while not ended.wait(every_s):
            if state != told or time.monotonic() - told_s >= STILL_EVERY_S:
                say()
            if time.monotonic() - begun_s > LONG_S:
                every_s = LONG_LINE_EVERY_S

    talking = Thread(target=talk, daemon=True)
    talking.start()
    try:
        yield tick
    finally:
        ended.set()
        talking.join()
        if told and told != state:
            say()
