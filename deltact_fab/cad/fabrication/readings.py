"""Readings of the coupons to what printer and laser do, and to a design that counts on it.

A table of readings is a CSV file with a header:

    coupon,feature,nominal_mm,measured_mm,pieces
    fit-coupon,hole,3.0,2.93,
    fit-coupon,outside,8.0,8.05,
    kerf-coupon,strip,100.0,98.1,10

feature: hole, slot, outside or height of the fit coupon; strip or thickness of the kerf coupon.
pieces: strips measured side by side, 1 where it is left out; nominal and measured are the stack's.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ... import catalog
from ...errors import InputError, did_you_mean
from ..dimensions import Design

FEATURES = {
    "fit-coupon": ("hole", "slot", "outside", "height"),
    "kerf-coupon": ("strip", "thickness"),
}
COLUMNS = ("coupon", "feature", "nominal_mm", "measured_mm", "pieces")
LEAST = 3
MAX_OFF = 0.5  # share of the nominal: beyond it two columns were confused


@dataclass(frozen=True)
class Reading:
    """One line of the table."""

    coupon: str
    feature: str
    nominal_mm: float
    measured_mm: float
    pieces: int = 1

    @property
    def off_mm(self) -> float:
        """Measured less nominal, of one piece."""
        return (self.measured_mm - self.nominal_mm) / self.pieces


@dataclass(frozen=True)
class MeasuredKey:
    """A key of a design with what was read beside what it had.

    bias_mm: mean of the readings' deviations; spread_mm: that of a further piece about the mean,
    +-, at 95 %. count: readings.
    """

    key: str
    value: float
    before: float
    count: int
    bias_mm: float
    spread_mm: float


def read(path: Path) -> list[Reading]:
    """The readings of a table. Raises InputError naming file, line and column."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as why:
        reason = why.strerror if isinstance(why, OSError) else "not UTF-8"
        raise InputError(f"{path}: cannot be read: {reason}") from why
    lines = csv.reader(text.splitlines())
    header = [name.strip() for name in next(lines, [])]
    for name in COLUMNS[:-1]:
        if name not in header:
            raise InputError(f"{path}: line 1: no column {name}; expected {', '.join(COLUMNS)}")
    for name in header:
        if name not in COLUMNS:
            raise InputError(f"{path}: line 1: column {name!r}: {did_you_mean(name, COLUMNS)}")
    found = []
    for values in lines:
        where = f"{path}: line {lines.line_num}"
        if not any(value.strip() for value in values):
            continue
        if len(values) > len(header):
            raise InputError(f"{where}: {len(values)} columns; expected {len(header)}")
        row = {k: v.strip() for k, v in zip(header, values, strict=False)}
        found.append(_reading(row, where))
    if not found:
        raise InputError(f"{path}: no reading")
    return found


def _reading(row: dict[str, str], where: str) -> Reading:
    coupon, feature = row.get("coupon", ""), row.get("feature", "")
    if coupon not in FEATURES:
        raise InputError(f"{where}: coupon {coupon!r}: {did_you_mean(coupon, FEATURES)}")
    if feature not in FEATURES[coupon]:
        hint = did_you_mean(feature, FEATURES[coupon])
        raise InputError(f"{where}: feature {feature!r}: {hint}")
    nominal = _length(row, "nominal_mm", where)
    measured = _length(row, "measured_mm", where)
    pieces = row.get("pieces", "") or "1"
    if not (pieces.isdecimal() and int(pieces) >= 1):
        raise InputError(f"{where}: pieces {pieces!r}: expected a whole number from 1")
    if pieces != "1" and feature != "strip":
        raise InputError(f"{where}: pieces {pieces!r}: expected 1 unless it is a strip")
    if abs(measured - nominal) > MAX_OFF * nominal:
        raise InputError(
            f"{where}: measured_mm {measured:g}: expected within {MAX_OFF:.0%} of "
            f"nominal_mm {nominal:g}"
        )
    return Reading(coupon, feature, nominal, measured, int(pieces))


def _length(row: dict[str, str], column: str, where: str) -> float:
    text = row.get(column, "")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{where}: {column} {text!r}: expected a length above 0")
    return value


def estimates(readings: Sequence[Reading], design: Design) -> list[MeasuredKey]:
    """What the readings say of the machines; a machine that was not measured keeps its figures.

    The spread is the half width of the interval that holds one further piece at 95 %:
    t s sqrt(1 + 1 / n), Student's t with n - 1 degrees of freedom (ISO 16269-8). Raises InputError
    where a group has too few readings.
    """
    printer, laser = design.resin_printer, design.laser
    found: list[MeasuredKey] = []
    spreads = []
    for key, name, features in (
        ("hole_bias_mm", "hole and slot", ("hole", "slot")),
        ("outside_bias_mm", "outside", ("outside",)),
    ):
        if off := _off(readings, *features):
            bias, spread = _of(off, name)
            spreads.append((spread, len(off)))
            about = (getattr(printer, key), len(off), bias, spread)
            found.append(MeasuredKey(f"resin_printer.{key}", round(bias, 3), *about))
    if spreads:
        spread, count = max(spreads)
        found.append(_spread("resin_printer.plane_mm", spread, printer.plane_mm, count, 0.0))
    if off := _off(readings, "height"):
        bias, spread = _of(off, "height")
        # Heights go both ways in a stack: their bias counts as spread.
        found.append(_spread("resin_printer.height_mm", spread, printer.height_mm, len(off), bias))
    if strips := [r for r in readings if r.feature == "strip"]:
        pieces = sum(r.pieces for r in strips)
        short = sum(r.nominal_mm - r.measured_mm for r in strips) / pieces
        kerf = max(short + (laser.kerf_mm if laser.compensate else 0.0), 0.0)
        single = [r.off_mm for r in strips if r.pieces == 1]
        spread = _of(single, "strip of one piece")[1] if single else math.nan
        about = (laser.kerf_mm, pieces, -short, spread)
        found.append(MeasuredKey("laser.kerf_mm", round(kerf, 3), *about))
        if single:
            found.append(
                _spread("laser.tolerance_mm", spread, laser.tolerance_mm, len(single), 0.0)
            )
    if off := _off(readings, "thickness"):
        bias, spread = _of(off, "thickness")
        share = max(_up((abs(bias) + spread) / design.optics.acrylic_mm), 0.001)
        about = (laser.sheet_tolerance, len(off), bias, spread)
        found.append(MeasuredKey("laser.sheet_tolerance", share, *about))
    return found


def _off(readings: Sequence[Reading], *features: str) -> list[float]:
    return [r.off_mm for r in readings if r.feature in features]


def _of(off_mm: Sequence[float], name: str) -> tuple[float, float]:
    """Mean, and the half width for one further piece."""
    import statistics

    from scipy.stats import t

    n = len(off_mm)
    if n < LEAST:
        raise InputError(f"{name}: {n} readings; expected {LEAST} or more")
    width = float(t.ppf(0.975, n - 1)) * statistics.stdev(off_mm) * math.sqrt(1 + 1 / n)
    return statistics.fmean(off_mm), width


def _spread(key: str, spread: float, before: float, count: int, bias: float) -> MeasuredKey:
    """A spread as a field takes it: no less than a caliper tells, the bias on top."""
    return MeasuredKey(key, max(_up(abs(bias) + spread), 0.005), before, count, bias, spread)


def _up(value: float) -> float:
    return math.ceil(value * 1000 - 1e-9) / 1000


def as_design(base: str, found: Sequence[MeasuredKey], source: str) -> str:
    """The text of a design: the base, and what was read over it."""
    tables: dict[str, dict[str, object]] = {}
    for estimate in found:
        section, _, key = estimate.key.partition(".")
        tables.setdefault(section, {})[key] = estimate.value
    for table in tables.values():
        table["measured"] = list(table)
    about = (f"{base} as made by the machines that {source} was measured on (cad fit).",)
    return catalog.as_toml({"base": base, **tables}, about)
