"""Options and arguments that several commands share.

One file is written by `-o FILE`, a folder by `--out DIR`, and `--json` prints one JSON document on
stdout in place of the lines for a reader; whatever else is said goes to stderr.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from deltact_fab.common import check_writable

Decorator = Callable[..., Any]
PATH = click.Path(path_type=Path)

JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


def require_writable(file: Path) -> Path:
    """A file that a command writes where none was named. Raises InputError where it cannot be."""
    check_writable(file)
    return file


def _output_option(folder: bool, *names: str, **settings: Any) -> Decorator:
    """What a command writes: refused before the work where it cannot be, by an InputError."""

    def writable(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path | None:
        if path is not None:
            check_writable(path, folder)
        return path

    return click.option(*names, type=PATH, callback=writable, **settings)


def out_file(help: str, name: str = "out", flag: str = "-o", **settings: Any) -> Decorator:
    """`-o FILE`, the one file that a command writes."""
    return _output_option(False, flag, name, metavar="FILE", help=help, **settings)


def out_folder(help: str, flag: str = "--out", **settings: Any) -> Decorator:
    """`--out DIR`, the folder that a command writes into."""
    return _output_option(True, flag, metavar="DIR", help=help, **settings)


NEW_FILE = out_file(
    "File to write; an existing one is never overwritten.",
    show_default="NAME.toml in its folder, else in this one",
)  # fmt: skip


class Finite(click.FloatRange):
    """A float within bounds, and neither nan nor infinite."""

    name = "number"

    def _describe_range(self) -> str:
        """For the help; nothing where there are no limits."""
        return "" if self.min is None is self.max else super()._describe_range()

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """As click has it: ends with one line for what is no such number."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class Point(click.ParamType):
    """Two finite numbers, as in 8,-6."""

    name = "X,Y"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        """As click has it: ends with one line for anything else."""
        if isinstance(value, tuple):
            return value
        try:
            x, y = (float(part) for part in value.split(","))
        except ValueError:
            self.fail(f"{value!r}: two numbers in mm are needed, as in 8,-6", param, ctx)
        if not math.isfinite(x + y):
            self.fail(f"{value!r}: two numbers are needed that are finite", param, ctx)
        return x, y


NAME_OR_PATH = click.Path()
"""What the catalogue finds, by its name or at a path."""

DESIGN = click.option(
    "--design", type=NAME_OR_PATH, default="deltact", metavar="DESIGN",
    help="Design of the sensor: a name of `cad list designs` or a path.",
)  # fmt: skip
RIG = click.option(
    "--rig", "rig_name", type=NAME_OR_PATH, default="virtual", metavar="RIG",
    help="Rig: a name of `rig list` or a path.",
)  # fmt: skip
TIP_IS_CLEAR = click.option(
    "--tip-is-clear", is_flag=True,
    help="You confirm that the tip touches nothing, so that the stage may home.",
)  # fmt: skip

PROCESSES = click.option(
    "--jobs", type=click.IntRange(1, 256), metavar="N", show_default="one per processor",
    help="Processes at a time.",
)  # fmt: skip
ON = click.option(
    "--on", default="local", metavar="WHERE",
    help="Where jobs run: local, or a Dask scheduler as dask:tcp://HOST:PORT.",
)  # fmt: skip

SEED = click.IntRange(min=0)


def seed(help: str, default: int = 0) -> Decorator:
    """`--seed N`, of whatever a command draws at random."""
    return click.option("--seed", type=SEED, default=default, metavar="N", help=help)
