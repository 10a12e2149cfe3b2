"""A press as a lab measured it: depth and force, row by row, out of a CSV file."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...aliases import Field
from ...errors import InputError, did_you_mean

NEEDED = ("depth_mm", "normal_n")
OPTIONAL = ("shear_x_mm", "shear_y_mm", "fx_n", "fy_n")
MIN_ROWS = 6
STILL_MM = 0.02  # a stage repeats no better: less is no shear


@dataclass(frozen=True, eq=False)
class MeasuredIndentation:
    """Rows in the order measured. depth_mm (n,) into the gel; normal_n (n,) positive = pressed.

    shear_mm (n, 2): the indenter's move from where it touched, zeros without such columns.
    tangential_n (n, 2): force on the sensor along x and y, NaN where a column is missing.
    """

    name: str
    depth_mm: Field
    normal_n: Field
    shear_mm: Field
    tangential_n: Field

    @property
    def sheared(self) -> NDArray[np.bool_]:
        """(n,): rows from the first move in plane on."""
        return np.logical_or.accumulate(np.hypot(*self.shear_mm.T) > STILL_MM)

    @property
    def has_tangential(self) -> bool:
        """Whether a row was measured along x or y after a move in plane."""
        return bool(np.isfinite(self.tangential_n[self.sheared]).any())


def read_csv(path: Path | str) -> MeasuredIndentation:
    """Read NEEDED and OPTIONAL columns; others are left alone, `#` starts a comment line.

    Raises InputError naming file, line and column.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as why:
        raise InputError(f"{path}: {why.strerror or why}; a CSV file is needed") from why
    except UnicodeDecodeError as why:
        raise InputError(f"{path}: not UTF-8 text; a CSV file is needed") from why
    lines = _lines(text)
    try:
        number, header = next(lines)
    except StopIteration:
        raise InputError(f"{path}: empty; a header with {', '.join(NEEDED)} is needed") from None
    place = _columns(path, number, header)
    rows = []
    for number, cells in lines:
        if len(cells) != len(header):
            raise InputError(
                f"{path}:{number}: {len(cells)} values below {len(header)} columns; "
                "commas between values and points in numbers are needed"
            )
        rows.append([_number(path, number, name, cells[i]) for name, i in place.items()])
    if len(rows) < MIN_ROWS:
        raise InputError(f"{path}: {len(rows)} rows; at least {MIN_ROWS} are needed")
    data = dict(zip(place, np.array(rows).T, strict=True))
    n = len(rows)
    still, unknown = np.zeros(n), np.full(n, math.nan)
    _check_signs(path, data["depth_mm"], data["normal_n"])
    return MeasuredIndentation(
        name=path.name,
        depth_mm=data["depth_mm"],
        normal_n=data["normal_n"],
        shear_mm=np.stack([data.get(c, still) for c in ("shear_x_mm", "shear_y_mm")], axis=1),
        tangential_n=np.stack([data.get(c, unknown) for c in ("fx_n", "fy_n")], axis=1),
    )


def before_drag(data: MeasuredIndentation) -> MeasuredIndentation:
    """The rows before the first move in plane; the same object where there is none.

    Raises InputError where fewer than MIN_ROWS are left.
    """
    keep = ~data.sheared
    if keep.all():
        return data
    if keep.sum() < MIN_ROWS:
        raise InputError(
            f"{data.name}: {int(keep.sum())} rows before the first shear; at least {MIN_ROWS} "
            "are needed to find the first touch"
        )
    parts = ("depth_mm", "normal_n", "shear_mm", "tangential_n")
    return replace(data, **{name: getattr(data, name)[keep] for name in parts})


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and stripped cells, without blank lines and comments."""
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, [cell.strip() for cell in next(csv.reader([line]))]


def _columns(path: Path, number: int, header: list[str]) -> dict[str, int]:
    for name in (*NEEDED, *OPTIONAL):
        if header.count(name) > 1:
            raise InputError(f"{path}:{number}: column {name} occurs twice; once is needed")
    for name in NEEDED:
        if name not in header:
            near = did_you_mean(name, [c for c in header if c])
            hint = f"; {near}" if near.startswith("did") else ""
            raise InputError(
                f"{path}:{number}: no column {name}; found {', '.join(header)}; "
                f"{' and '.join(NEEDED)} are needed{hint.replace('did you mean', 'is it')}"
            )
    return {name: header.index(name) for name in (*NEEDED, *OPTIONAL) if name in header}


def _number(path: Path, line: int, column: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(
            f"{path}:{line}: column {column}: {text!r} is not a number; a finite one is needed"
        )
    return value


def _check_signs(path: Path, depth_mm: Field, normal_n: Field) -> None:
    deep = depth_mm >= np.quantile(depth_mm, 0.8)
    push, rest = float(normal_n[deep].mean()), float(normal_n[~deep].mean()) if any(~deep) else 0.0
    if not push > 0:
        raise InputError(
            f"{path}: column normal_n: {push:.3g} N on average where the press is deepest; "
            "positive = pressed is needed"
        )
    if not push > rest:
        raise InputError(
            f"{path}: column depth_mm: force does not grow with depth; depth positive into the "
            "gel is needed"
        )
