"""Options and numbers that several commands share."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON.")

NEW_FILE = click.option(
    "-o", "out", type=click.Path(path_type=Path), help="File to write; never one that is there.",
    show_default="NAME.toml in its folder, or here",
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
            self.fail(f"{value} is no finite number.", param, ctx)
        return number


SEED = click.IntRange(min=0)
