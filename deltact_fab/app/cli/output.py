"""Output for people and programs: tables, JSON, progress."""

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
from .options import JSON_OPTION

if TYPE_CHECKING:
    from deltact_fab.common import Check, Progress

LINE_EVERY_S = 10.0
"""Interval of progress lines without a terminal; by hand: readable in a log."""
_COLUMN_GAP = "  "
_CELL_DIGITS = 4  # significant digits of a number; by hand: more make tables wide


def echo_json(data: Any) -> None:
    """Print plain data as JSON; NaN is refused, as JSON has none."""
    click.echo(json.dumps(data, indent=1, allow_nan=False))


@dataclass(frozen=True)
class Answer:
    """Result of a command.

    data: for a program, without NaN; lines: text; asides: on stderr, after either. failed: reason
    of exit code 1, empty if the lines contain it; None for success.
    """

    data: Any
    lines: Iterable[str] = ()
    failed: str | None = None
    asides: Iterable[str] = ()


def answers(command: Callable[..., Answer]) -> Callable[..., None]:
    """Add `--json` to a command, and print its Answer."""

    @wraps(command)
    def print_answer(as_json: bool, **params: Any) -> None:
        answer = command(**params)
        if as_json:
            echo_json(answer.data)
        else:
            for line in answer.lines:
                click.echo(line)
        for line in answer.asides:
            click.echo(line, err=True)
        if answer.failed is not None:
            raise RunFailed(answer.failed) if answer.failed else click.exceptions.Exit(1)

    return JSON_OPTION(print_answer)


def file_note(file: Path, then: str = "") -> Answer:
    """Report the file written and, if it is to be edited, the next command."""
    line = f"written: {file}" + (f"; edit it, then run `deltact-fab {then}`" if then else "")
    return Answer({"file": str(file)}, [line])


def files_line(files: Iterable[Path]) -> str:
    """Format the last line of a command that writes several files."""
    return f"written: {', '.join(map(str, files))}"


def listing(columns: Sequence[str], rows: Sequence[Sequence[Any]], *notes: str) -> Answer:
    """List rows: a table, or one JSON object per row; notes: lines below the table."""
    data = [dict(zip(columns, row, strict=True)) for row in rows]
    return Answer(data, [*table(columns, rows), *notes])


def columns_of(names: Sequence[str], records: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """Format a table of the named values of records."""
    return table(names, [[record.get(name) for name in names] for record in records])


def pairs(data: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of nested tables with their dotted keys, without None."""
    for key, value in data.items():
        if isinstance(value, Mapping):
            yield from pairs(value, f"{prefix}{key}.")
        elif value is not None:
            yield f"{prefix}{key}", value


def grade(name: str, result: Any, success: str, *notes: str) -> Answer:
    """Report a verdict and the checks behind it, those of result.rows."""
    failed = [row.name for row in result.rows if row.failed]
    verdict = f"{name}: {'fails: ' + ', '.join(failed) if failed else success}"
    data = {**result.as_dict(), "rows": [of_image(row) for row in result.rows]}
    return Answer(data, [verdict, "", *check_lines(result.rows), *notes], "" if failed else None)


def check_lines(checks: Iterable[Check]) -> Iterator[str]:
    """Format the table of checks, one line each."""
    words = {"warn": "WARN", "fail": "FAIL"}
    return compact(
        ("", "check", "subject", "found", "limit", "basis", "remedy"),
        [
            (words.get(c.status, c.status), c.name, c.subject,
             *(("OK", "") if c.subject == "refusals" and c.status == "pass" else
               (_format_cell(c.value), f"{c.sign} {_format_cell(c.limit)}".lstrip())),
             ", ".join(c.basis), c.remedy if c.status in words else "")
            for c in checks
        ],
    )  # fmt: skip


def compact(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Format a table of texts without its empty columns."""
    filled = [i for i in range(len(columns)) if any(row[i] for row in rows)]
    return table([columns[i] for i in filled], [[row[i] for i in filled] for row in rows])


def table(columns: Sequence[str], records: Iterable[Sequence[Any]]) -> Iterator[str]:
    """Format rows under their columns, numbers to the right.

    On a narrow terminal cells are wrapped. Elsewhere a row is always one line.
    """
    rows = list(records)
    right = [bool(rows) and all(_is_number(row[i]) for row in rows) for i in range(len(columns))]
    cells = [_format_column([row[i] for row in rows]) for i in range(len(columns))]
    widths = [max(map(len, (c, *column))) for c, column in zip(columns, cells, strict=True)]
    terminal_width = shutil.get_terminal_size().columns
    if sys.stdout.isatty() and sum(widths) + len(_COLUMN_GAP) * (len(widths) - 1) > terminal_width:
        yield from _wrap_table(columns, right, list(zip(*cells, strict=True)), terminal_width)
        return
    for row in [columns, *zip(*cells, strict=True)]:
        aligned = [
            cell.rjust(width) if number else cell.ljust(width)
            for cell, width, number in zip(row, widths, right, strict=True)
        ]
        yield _COLUMN_GAP.join(aligned).rstrip()


def _wrap_table(
    columns: Sequence[str], right: list[bool], rows: Sequence[Sequence[str]], width: int
) -> list[str]:
    from rich.console import Console
    from rich.table import Table

    grid = Table(box=None, padding=(0, len(_COLUMN_GAP), 0, 0), pad_edge=False, header_style="")
    for name, number in zip(columns, right, strict=True):
        grid.add_column(name, justify="right" if number else "left", overflow="fold")
    for row in rows:
        grid.add_row(*row)
    console = Console(width=width, markup=False, highlight=False, emoji=False, color_system=None)
    with console.capture() as capture:
        console.print(grid)
    return [line.rstrip() for line in capture.get().splitlines()]


def _format_column(values: Sequence[Any]) -> list[str]:
    """Format the cells of a column; floats of similar size get equal decimals, to align points."""
    numbers = [abs(v) for v in values if isinstance(v, int | float) and math.isfinite(v) and v]
    largest = max(numbers, default=0.0)
    # Rounding errors of cancelled terms count as 0.
    cleaned = [0 if isinstance(v, float) and 0 < abs(v) <= 1e-9 * largest else v for v in values]
    sizes = [n for n in numbers if n > 1e-9 * largest]
    near = all(map(_is_number, values)) and min(sizes, default=0) >= max(1e-4, largest / 1e3)
    if not near:
        return list(map(_format_cell, cleaned))
    decimals = max(0, _CELL_DIGITS - 1 - math.floor(math.log10(largest)))
    return [f"{v:.{decimals}f}" if isinstance(v, float) else _format_cell(v) for v in cleaned]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | None) and not isinstance(value, bool)


def _format_cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        # Without an exponent between 0.0001 and a million.
        as_integer = 10**_CELL_DIGITS <= abs(value) < 1e6
        return f"{value:.0f}" if as_integer else f"{value:.{_CELL_DIGITS}g}"
    if isinstance(value, list | tuple):
        return ", ".join(map(_format_cell, value)) or "none"
    return str(value)


def save_figures(folder: Path, draw: Callable[[], Mapping[str, Any]]) -> list[Path]:
    """Write figures as NAME.svg and return the files; warn without matplotlib.

    draw: makes the figures by name; None is skipped. Raises RunFailed if the disk fails.
    """
    files = []
    try:
        from deltact_fab.present import figure_bytes

        for name, figure in draw().items():
            if figure is not None:
                write_whole(folder / f"{name}.svg", figure_bytes(figure, "svg"))
                files.append(folder / f"{name}.svg")
    except MissingLibrary as error:
        click.echo(f"no figures: {error}", err=True)
    return files


@contextmanager
def progress(title: str) -> Iterator[Progress]:
    """Show progress on stderr: a bar on a terminal, otherwise occasional lines.

    A command that ends within LINE_EVERY_S writes no line.
    """
    if not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        with _progress_lines(title) as tick:
            yield tick
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    with Progress(
        TextColumn(f"{title:<22}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("remaining"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[what]}", markup=False),
        console=Console(stderr=True),
    ) as bar:
        task = bar.add_task(title, total=None, what="")
        yield lambda count, total, label: bar.update(task, completed=count, total=total, what=label)


@contextmanager
def _progress_lines(title: str) -> Iterator[Progress]:
    start_s = printed_s = time.monotonic()
    state = printed = ""

    def say() -> None:
        nonlocal printed, printed_s
        printed, printed_s = state, time.monotonic()
        click.echo(f"{title}: {format_duration(printed_s - start_s)}: {printed}", err=True)

    def tick(count: int, total: int, label: str) -> None:
        nonlocal state
        state = f"{count} of {total}" + (f", {label}" if label else "")
        if time.monotonic() - printed_s >= LINE_EVERY_S:
            say()

    yield tick
    if printed and printed != state:
        say()
