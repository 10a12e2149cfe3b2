"""Printing for people and for programs: tables, JSON, how far a command has come."""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from deltact_fab.common import MissingLibrary, RunFailed, format_duration, write_whole

from .old_keys import of_image
from .options import JSON

if TYPE_CHECKING:
    from deltact_fab.common import Check, Progress

LINE_EVERY_S = 10.0
"""Where no terminal shows a bar: a line so often, when there is something new to say."""
_GAP = "  "
_DIGITS = 4  # significant ones of a number that a person reads


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


def columns_of(names: Sequence[str], records: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """A table of these values of records, each under its name."""
    return table(names, [[record.get(name) for name in names] for record in records])


def facts(data: Mapping[str, Any], at: str = "") -> Iterator[tuple[str, Any]]:
    """The values of nested tables, each with its path, without those that are None."""
    for key, value in data.items():
        if isinstance(value, Mapping):
            yield from facts(value, f"{at}{key}.")
        elif value is not None:
            yield f"{at}{key}", value


def judged(name: str, done: Any, right: str, *more: str) -> Answer:
    """A verdict, then the checks behind it, those of done.rows."""
    failed = [row.name for row in done.rows if row.failed]
    verdict = f"{name}: {'fails: ' + ', '.join(failed) if failed else right}"
    data = {**done.as_dict(), "rows": [of_image(row) for row in done.rows]}
    return Answer(data, [verdict, "", *check_lines(done.rows), *more], "" if failed else None)


def check_lines(checks: Iterable[Check]) -> Iterator[str]:
    """The table of checks, a line each."""
    words = {"warn": "WARN", "fail": "FAIL"}
    return compact(
        ("", "check", "of", "found", "limit", "basis", "what to do"),
        [
            (words.get(c.status, c.status), c.name, c.subject, _cell(c.value),
             f"{c.sign} {_cell(c.limit)}".lstrip(), ", ".join(c.basis),
             c.remedy if c.status in words else "")
            for c in checks
        ],
    )  # fmt: skip


def compact(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """A table of texts without the columns that are empty in every row."""
    kept = [i for i in range(len(columns)) if any(row[i] for row in rows)]
    return table([columns[i] for i in kept], [[row[i] for i in kept] for row in rows])


def table(columns: Sequence[str], given: Iterable[Sequence[Any]]) -> Iterator[str]:
    """The lines of rows under their columns, numbers to the right.

    On a terminal that is too narrow cells are wrapped. Elsewhere a row is always one line.
    """
    rows = list(given)
    right = [bool(rows) and all(_is_number(row[i]) for row in rows) for i in range(len(columns))]
    cells = [_column([row[i] for row in rows]) for i in range(len(columns))]
    whole = [max(map(len, (c, *column))) for c, column in zip(columns, cells, strict=True)]
    most = shutil.get_terminal_size().columns
    if sys.stdout.isatty() and sum(whole) + len(_GAP) * (len(whole) - 1) > most:
        yield from _wrapped(columns, right, list(zip(*cells, strict=True)), most)
        return
    for row in [columns, *zip(*cells, strict=True)]:
        placed = [
            cell.rjust(width) if number else cell.ljust(width)
            for cell, width, number in zip(row, whole, right, strict=True)
        ]
        yield _GAP.join(placed).rstrip()


def _wrapped(
    columns: Sequence[str], right: list[bool], rows: Sequence[Sequence[str]], width: int
) -> list[str]:
    from rich.console import Console
    from rich.table import Table

    shown = Table(box=None, padding=(0, len(_GAP), 0, 0), pad_edge=False, header_style="")
    for name, number in zip(columns, right, strict=True):
        shown.add_column(name, justify="right" if number else "left", overflow="fold")
    for row in rows:
        shown.add_row(*row)
    console = Console(width=width, markup=False, highlight=False, emoji=False, color_system=None)
    with console.capture() as said:
        console.print(shown)
    return [line.rstrip() for line in said.get().splitlines()]


def _column(values: Sequence[Any]) -> list[str]:
    """The cells of a column; floats of like size get as many decimals, so that points align."""
    numbers = [abs(v) for v in values if isinstance(v, int | float) and math.isfinite(v) and v]
    largest = max(numbers, default=0.0)
    # What cancelled is none.
    kept = [0 if isinstance(v, float) and 0 < abs(v) <= 1e-9 * largest else v for v in values]
    some = [n for n in numbers if n > 1e-9 * largest]
    alike = all(map(_is_number, values)) and min(some, default=0) >= max(1e-4, largest / 1e3)
    if not alike:
        return list(map(_cell, kept))
    decimals = max(0, _DIGITS - 1 - math.floor(math.log10(largest)))
    return [f"{v:.{decimals}f}" if isinstance(v, float) else _cell(v) for v in kept]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | None) and not isinstance(value, bool)


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        # Without an exponent between 0.0001 and a million.
        whole = 10**_DIGITS <= abs(value) < 1e6
        return f"{value:.0f}" if whole else f"{value:.{_DIGITS}g}"
    if isinstance(value, list | tuple):
        return ", ".join(map(_cell, value)) or "none"
    return str(value)


def save_figures(folder: Path, drawn: Callable[[], Mapping[str, Any]]) -> list[Path]:
    """Write figures as NAME.svg and return the files; say so where there is no matplotlib.

    drawn: makes them, by name; None is nothing to draw. Raises RunFailed when the disk refuses.
    """
    files = []
    try:
        from deltact_fab.present import figure_bytes

        for name, figure in drawn().items():
            if figure is not None:
                write_whole(folder / f"{name}.svg", figure_bytes(figure, "svg"))
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
    begun_s = told_s = time.monotonic()
    state = told = ""

    def say() -> None:
        nonlocal told, told_s
        told, told_s = state, time.monotonic()
        click.echo(f"{title}: {format_duration(told_s - begun_s)}: {told}", err=True)

    def tick(done: int, total: int, what: str) -> None:
        nonlocal state
        state = f"{done} of {total}" + (f", {what}" if what else "")
        if time.monotonic() - told_s >= LINE_EVERY_S:
            say()

    yield tick
    if told and told != state:
        say()
