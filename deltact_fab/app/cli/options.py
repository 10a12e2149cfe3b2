"""Options and arguments shared by several commands.

`-o FILE` writes one file, `--out DIR` a folder, and `--json` prints one JSON document on stdout
instead of text; all other messages go to stderr.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import click

from deltact_fab.common import check_writable

Decorator = Callable[..., Any]
PATH_TYPE = click.Path(path_type=Path)

JSON_OPTION = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


def require_writable(file: Path) -> Path:
    """Return the default output file. Raises InputError if it cannot be written."""
    check_writable(file)
    return file


def _output_option(folder: bool, *names: str, **settings: Any) -> Decorator:
    """Make an output option; InputError, before the work, if the path cannot be written."""

    def writable(ctx: click.Context, param: click.Parameter, path: Path | None) -> Path | None:
        if path is not None:
            check_writable(path, folder)
        return path

    return click.option(*names, type=PATH_TYPE, callback=writable, **settings)


def out_file(help: str, name: str = "out", flag: str = "-o", **settings: Any) -> Decorator:
    """Make `-o FILE`, the output file of a command."""
    return _output_option(False, flag, name, metavar="FILE", help=help, **settings)


def out_folder(help: str, flag: str = "--out", **settings: Any) -> Decorator:
    """Make `--out DIR`, the output folder of a command."""
    return _output_option(True, flag, metavar="DIR", help=help, **settings)


NEW_FILE = out_file(
    "File to write; an existing one is never overwritten.",
    show_default="NAME.toml in its folder, else in this one",
)  # fmt: skip


class Finite(click.FloatRange):
    """Finite float within bounds."""

    name = "number"

    def _describe_range(self) -> str:
        """Return the range for the help; empty without limits."""
        return "" if self.min is None is self.max else super()._describe_range()

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert as click does; reject nan and inf."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class Point(click.ParamType):
    """Two finite numbers, such as 8,-6."""

    name = "X,Y"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        """Convert as click does; reject anything but two finite numbers."""
        if isinstance(value, tuple):
            return value
        try:
            x, y = (float(part) for part in value.split(","))
        except ValueError:
            self.fail(f"{value!r}: must be two numbers in mm, such as 8,-6", param, ctx)
        if not math.isfinite(x + y):
            self.fail(f"{value!r}: must be two finite numbers", param, ctx)
        return x, y


class RepeatedOptions(click.Command):
    """Command whose repeatable options take all values behind them, as shells expand them."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse, with the option repeated before each of its values."""
        options = (p for p in self.params if isinstance(p, click.Option) and p.multiple)
        repeatable = {flag for option in options for flag in option.opts}
        spread: list[str] = []
        flag = ""
        for k, arg in enumerate(args):
            if arg.startswith("-"):
                flag = arg if arg in repeatable else ""
            elif flag and args[k - 1] != flag:
                spread.append(flag)
            spread.append(arg)
        return super().parse_args(ctx, spread)


class Quantity(click.ParamType):
    """Positive number with a unit, such as 8N, 90min or 15%."""

    name = "quantity"
    FACTORS: ClassVar[dict[str, dict[str, float]]] = {
        "N": {"N": 1, "mN": 1e-3},
        "s": {"s": 1, "min": 60, "h": 3600},
        "ms": {"ms": 1},
        "mm": {"mm": 1, "um": 1e-3},
        "%": {"%": 1},
    }
    """Factors by unit, by base unit; all by definition."""

    def __init__(self, *bases: str) -> None:
        """bases: base units of FACTORS that the number may have."""
        self.bases = bases
        units = ((unit, (factor, b)) for b in bases for unit, factor in self.FACTORS[b].items())
        self.units = dict(units)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number in the base unit, with that unit if there are several."""
        if not isinstance(value, str):
            return value
        text = re.sub(r"\s*([a-zA-Z]+|%)\s*$", "", value)
        factor, base = self.units.get(value.removeprefix(text).strip(), (math.nan, ""))
        try:
            number = float(text) * factor
        except ValueError:
            number = math.nan
        if not 0 < number < math.inf:
            units = " or ".join(self.units)
            self.fail(f"{value!r}: must be a positive number with {units}", param, ctx)
        return number if len(self.bases) == 1 else (number, base)


NAME_OR_PATH = click.Path()
"""Name in the catalogue, or a path."""

DESIGN_OPTION = click.option(
    "--design", type=NAME_OR_PATH, default="deltact", metavar="DESIGN",
    help="Design of the sensor: a name of `cad list designs` or a path.",
)  # fmt: skip
RIG_OPTION = click.option(
    "--rig", "rig_name", type=NAME_OR_PATH, default="virtual", metavar="RIG",
    help="Rig: a name of `rig list` or a path.",
)  # fmt: skip
TIP_IS_CLEAR = click.option(
    "--tip-is-clear", is_flag=True,
    help="Confirm that the tip touches nothing, so that the stage may home."
)  # fmt: skip

JOBS_OPTION = click.option(
    "--jobs", type=click.IntRange(1, 256), metavar="N", show_default="one per processor",
    help="Number of processes."
)  # fmt: skip
ON_OPTION = click.option(
    "--on", default="local", metavar="WHERE",
    help="Where jobs run: local, or a Dask scheduler as dask:tcp://HOST:PORT.",
)  # fmt: skip
GRID_OPTIONS = (JOBS_OPTION, ON_OPTION)

SEED_TYPE = click.IntRange(min=0)
SENSOR_OPTION = click.option(
    "--sensor", type=SEED_TYPE, metavar="N",
    help="Sensor number N of the rig's [virtual.population]; without it the nominal sensor."
)  # fmt: skip


def seed(help: str, default: int | None = 0) -> Decorator:
    """Make `--seed N`, for all random numbers of a command."""
    return click.option("--seed", type=SEED_TYPE, default=default, metavar="N", help=help)
