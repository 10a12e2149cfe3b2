"""A press measured by a lab: depth and force, row by row, from a CSV file."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from deltact_fab.common import Field, InputError, read_text

PRESS_COLUMNS = ("depth_mm", "normal_n")
SHEAR_COLUMNS = ("shear_x_mm", "shear_y_mm")
MIN_ROWS = 6  # by hand: fewer give no interval of a modulus
STILL_MM = 0.02  # by hand, about a stage's repeatability: a smaller move is no shear


@dataclass(frozen=True, eq=False)
class MeasuredIndentation:
    """Rows in the order measured. depth_mm (n,) into the gel; normal_n (n,) positive = pressed.

    dragged: number of rows not used, from the first move in plane on.
    """

    name: str
    depth_mm: Field
    normal_n: Field
    dragged: int = 0

    @classmethod
    def from_csv(cls, path: Path | str) -> Self:
        """Read PRESS_COLUMNS, and SHEAR_COLUMNS for a drag; other columns are ignored.

        `#` starts a comment. Raises InputError naming file, line and column.
        """
        path = Path(path)
        lines = _lines(read_text(path))
        number, header = next(lines, (0, []))
        if not header:
            raise InputError(f"{path}: empty; expected a header with {', '.join(PRESS_COLUMNS)}")
        for name in (*PRESS_COLUMNS, *SHEAR_COLUMNS):
            if header.count(name) > 1:
                raise InputError(f"{path}:{number}: column {name} occurs twice; expected once")
            if name in PRESS_COLUMNS and name not in header:
                raise InputError(
                    f"{path}:{number}: no column {name}; expected {' and '.join(PRESS_COLUMNS)} "
                    f"(got {', '.join(header)})"
                )
        place = {n: header.index(n) for n in (*PRESS_COLUMNS, *SHEAR_COLUMNS) if n in header}
        rows = []
        for number, cells in lines:
            if len(cells) != len(header):
                raise InputError(
                    f"{path}:{number}: {len(cells)} values below {len(header)} columns; "
                    "expected commas between values, points in numbers"
                )
            rows.append([_number(path, number, name, cells[i]) for name, i in place.items()])
        table = np.array(rows).reshape(len(rows), len(place))
        dragged = np.logical_or.accumulate((np.abs(table[:, 2:]) > STILL_MM).any(axis=1))
        depth_mm, normal_n = table[~dragged, :2].T
        return cls.from_rows(str(path), depth_mm, normal_n, int(dragged.sum()))

    @classmethod
    def from_rows(cls, name: str, depth_mm: Field, normal_n: Field, dragged: int) -> Self:
        """Rows of a press without a drag. Raises InputError for too few, or for wrong signs."""
        if len(depth_mm) < MIN_ROWS:
            raise InputError(
                f"{name}: {len(depth_mm)} rows of a straight press; at least {MIN_ROWS} are needed"
            )
        deep = depth_mm >= np.quantile(depth_mm, 0.8)
        push, rest = normal_n[deep].mean(), normal_n[~deep].sum() / max(1, int(np.sum(~deep)))
        if not push > 0:
            raise InputError(
                f"{name}: column normal_n: {push:.3g} N on average where the press is deepest; "
                "expected positive when pressed"
            )
        if not push > rest:
            raise InputError(
                f"{name}: column depth_mm: force does not grow with depth; expected depth > 0 into "
                "the gel"
            )
        return cls(name, depth_mm, normal_n, dragged)


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield line numbers and stripped cells, without blank lines and comments."""
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, [cell.strip() for cell in next(csv.reader([line]))]


def _number(path: Path, line: int, column: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{path}:{line}: column {column}: {text!r} is not a finite number")
    return value
