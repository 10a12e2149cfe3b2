"""Printing for people and for programs: aligned tables, JSON, progress on a terminal."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click


def echo_json(data: Any) -> None:
    """Print plain data as JSON; NaN is refused, for no JSON reader takes it."""
    click.echo(json.dumps(data, indent=1, allow_nan=False))


def echo_written(file: Path, then: str, as_json: bool) -> None:
    """Say which file was written and what to do with it."""
    if as_json:
        echo_json({"file": str(file)})
    else:
        click.echo(f"{file}: written; change it, then `deltact-fab {then}`")


def echo_table(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Print rows under their columns; numbers to the right, with four significant digits."""
    cells = [[_cell(value) for value in row] for row in rows]
    widths = [max(len(c), *(len(row[i]) for row in cells), 0) for i, c in enumerate(columns)]
    right = [
        bool(rows) and all(isinstance(row[i], int | float | None) for row in rows)
        for i in range(len(columns))
    ]
    for line in [list(columns), *cells]:
        parts = [
            c.rjust(w) if r else c.ljust(w) for c, w, r in zip(line, widths, right, strict=True)
        ]
        click.echo("  ".join(parts).rstrip())


def save_figures(folder: Path, drawn: Callable[[], Mapping[str, Any]]) -> list[Path]:
    """Write figures as NAME.svg and return the files; say so where there is no matplotlib.

    drawn: makes them, by name; None is nothing to draw. Raises RunFailed when the disk refuses.
    """
    from ..errors import MissingLibrary
    from ..record import write_whole

    files = []
    try:
        from ..report.paper_figures import as_bytes

        for name, figure in drawn().items():
            if figure is not None:
                write_whole(folder / f"{name}.svg", as_bytes(figure, "svg"))
                files.append(folder / f"{name}.svg")
    except MissingLibrary as why:
        click.echo(f"no figures: {why}", err=True)
    return files


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


@contextmanager
def progress(title: str) -> Iterator[Callable[[int, int, str], None]]:
    """A progress bar on stderr when that is a terminal, else nothing."""
    if not sys.stderr.isatty():
        yield lambda done, total, what: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    with Progress(
        TextColumn(f"{title:<22}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[what]}"),
        console=Console(stderr=True),
    ) as bar:
        task = bar.add_task(title, total=None, what="")
        yield lambda done, total, what: bar.update(task, completed=done, total=total, what=what)
