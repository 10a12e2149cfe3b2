"""Fit printer and laser errors to coupon readings, and write a design with them.

A table of readings is a CSV file with a header:

    coupon,feature,nominal_mm,measured_mm,pieces
    fit-coupon,hole,3.0,2.93,
    fit-coupon,outside,8.0,8.05,
    kerf-coupon,strip,100.0,98.1,10

feature: hole, slot, outside or height of the fit coupon; strip or thickness of the kerf coupon.
pieces: strips measured side by side, default 1; nominal and measured are those of the stack.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Literal

from deltact_fab.common import InputError, did_you_mean, read_text, toml_text, validate

from ..design import load_design
from ..dimensions import Design

COUPON_FEATURES = {
    "fit-coupon": ("hole", "slot", "outside", "height"),
    "kerf-coupon": ("strip", "thickness"),
}
MIN_READINGS = 3  # by hand: with two, Student's t makes the spread useless
MAX_DEVIATION_SHARE = 0.5  # by hand, of the nominal: a larger one means swapped columns


@dataclass(frozen=True)
class Reading:
    """One line of the table. Raises ValueError for inconsistent values."""

    coupon: Literal["fit-coupon", "kerf-coupon"]
    feature: str
    nominal_mm: float = field(metadata={"gt": 0})
    measured_mm: float = field(metadata={"gt": 0})
    pieces: int = field(default=1, metadata={"ge": 1})

    __pydantic_config__ = {"extra": "forbid", "allow_inf_nan": False}  # noqa: RUF012

    def __post_init__(self) -> None:
        if self.feature not in COUPON_FEATURES[self.coupon]:
            hint = did_you_mean(self.feature, COUPON_FEATURES[self.coupon])
            raise ValueError(f"feature {self.feature!r}: {hint}")
        if self.pieces != 1 and self.feature != "strip":
            raise ValueError(f"pieces {self.pieces}: expected 1 unless it is a strip")
        if abs(self.measured_mm - self.nominal_mm) > MAX_DEVIATION_SHARE * self.nominal_mm:
            raise ValueError(
                f"measured_mm {self.measured_mm:g}: expected within {MAX_DEVIATION_SHARE:.0%} of "
                f"nominal_mm {self.nominal_mm:g}"
            )

    @property
    def off_mm(self) -> float:
        """Measured minus nominal, per piece."""
        return (self.measured_mm - self.nominal_mm) / self.pieces


@dataclass(frozen=True)
class MeasuredKey:
    """A key of a design with its measured and previous value.

    bias_mm: mean deviation of the readings; spread_mm: 95 % prediction interval of one further
    piece about the mean, +-. count: number of readings.
    """

    key: str
    value: float
    before: float
    count: int
    bias_mm: float
    spread_mm: float


def read_readings(path: Path) -> list[Reading]:
    """Read a table of readings. Raises InputError naming file, line and column."""
    table = csv.DictReader(read_text(path).splitlines(), restkey="beyond the last column")
    try:
        rows = [(table.line_num, row) for row in table]
    except csv.Error as error:
        raise InputError(f"{path}: line {table.line_num}: {error}") from error
    readings = []
    for line, row in rows:
        # Empty cells are ignored.
        cells = {key.strip(): _value(str(cell)) for key, cell in row.items() if cell}
        if values := {key: value for key, value in cells.items() if value != ""}:
            readings.append(validate(Reading, values, f"{path}: line {line}"))
    if not readings:
        raise InputError(
            f"{path}: no reading below a header of {', '.join(Reading.__match_args__)}"
        )
    return readings


def _value(cell: str) -> float | str:
    """Convert a cell to a number if possible."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(cell)
    return cell.strip()


def fit_readings(readings: Sequence[Reading], design: Design) -> list[MeasuredKey]:
    """Estimate bias and spread of the machines; one without readings keeps its values.

    Spread: half width of the 95 % prediction interval of one further piece, t s sqrt(1 + 1 / n),
    Student's t with n - 1 degrees of freedom (ISO 16269-8). Raises InputError if a group has too
    few readings.
    """
    # New value, number of readings, bias and spread by key.
    estimates: dict[str, tuple[float, int, float, float]] = {}

    def deviations_mm(*features: str) -> list[float]:
        return [r.off_mm for r in readings if r.feature in features]

    spreads = []
    for key, features in (("hole", ("hole", "slot")), ("outside", ("outside",))):
        if plan := deviations_mm(*features):
            bias, spread = _mean_and_spread(plan, " and ".join(features))
            spreads.append((spread, len(plan)))
            estimates[f"resin_printer.{key}_bias_mm"] = round(bias, 3), len(plan), bias, spread
    if spreads:
        spread, count = max(spreads)
        estimates["resin_printer.plane_mm"] = _round_spread(spread), count, 0.0, spread
    if heights := deviations_mm("height"):
        bias, spread = _mean_and_spread(heights, "height")
        # Heights enter a stack with either sign: their bias counts as spread.
        value = _round_spread(abs(bias) + spread)
        estimates["resin_printer.height_mm"] = value, len(heights), bias, spread
    if strips := [r for r in readings if r.feature == "strip"]:
        pieces = sum(r.pieces for r in strips)
        short = sum(r.nominal_mm - r.measured_mm for r in strips) / pieces
        kerf = max(short + (design.laser.kerf_mm if design.laser.compensate else 0.0), 0.0)
        single = [r.off_mm for r in strips if r.pieces == 1]
        spread = _mean_and_spread(single, "strip of one piece")[1] if single else math.nan
        estimates["laser.kerf_mm"] = round(kerf, 3), pieces, -short, spread
        if single:
            estimates["laser.tolerance_mm"] = _round_spread(spread), len(single), 0.0, spread
    if sheets := deviations_mm("thickness"):
        bias, spread = _mean_and_spread(sheets, "thickness")
        share = max(_round_up((abs(bias) + spread) / design.optics.acrylic_mm), 0.001)
        estimates["laser.sheet_tolerance"] = share, len(sheets), bias, spread
    return [
        MeasuredKey(key, value, attrgetter(key)(design), count, bias, spread)
        for key, (value, count, bias, spread) in estimates.items()
    ]


def _mean_and_spread(off_mm: Sequence[float], name: str) -> tuple[float, float]:
    """Return mean, and half width of the prediction interval of one further piece."""
    import statistics

    from scipy.stats import t

    n = len(off_mm)
    if n < MIN_READINGS:
        raise InputError(f"{name}: {n} readings; expected {MIN_READINGS} or more")
    width = float(t.ppf(0.975, n - 1)) * statistics.stdev(off_mm) * math.sqrt(1 + 1 / n)
    return statistics.fmean(off_mm), width


def _round_spread(spread_mm: float) -> float:
    """Round a spread up; at least 0.005 mm, a caliper's resolution."""
    return max(_round_up(spread_mm), 0.005)


def _round_up(value: float) -> float:
    return math.ceil(value * 1000 - 1e-9) / 1000


def fit_design(readings: Path, base: str) -> tuple[list[MeasuredKey], str]:
    """Fit a design to a table of readings: changed keys, and the text of a new design.

    Raises InputError as `read_readings`, `load_design` and `fit_readings`.
    """
    estimates = fit_readings(read_readings(readings), load_design(base))
    tables: dict[str, dict[str, object]] = {}
    for estimate in estimates:
        section, _, key = estimate.key.partition(".")
        tables.setdefault(section, {})[key] = estimate.value
    for table in tables.values():
        table["measured"] = list(table)
    about = (f"{base} as made by the machines that {readings.name} was measured on (cad fit).",)
    return estimates, toml_text({"base": base, **tables}, about)
