"""Comparison of two sides of runs by a measure, over their units."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

from deltact_fab.bench import Run, SensorLedger, open_run
from deltact_fab.common import InputError, Progress

from .difference import DECISION_CHANCE, MAX_UNITS, UnitDifference, chance_of_difference
from .intervals import MIN_GROUPS
from .press_figures import Measure, PressFigures, mean_interval, run_figures


@dataclass(frozen=True)
class Side:
    """Figures of one side: of each unit, and of each press of it."""

    label: str
    units: Mapping[str, float]
    presses: Mapping[str, PressFigures]


@dataclass(frozen=True)
class Comparison:
    """Comparison of two sides, a and b, by a measure.

    difference: of a less b over units, or over presses for one unit a side, which says nothing of a
    kind of sensor. margin: on the scale of the difference. noun: of what it is over. notes: what
    the difference may hold besides the sides.
    """

    measure: Measure
    a: Side
    b: Side
    difference: UnitDifference
    margin: float
    noun: str
    notes: tuple[str, ...]

    MIN_CHANCE: ClassVar = DECISION_CHANCE
    chance: ClassVar = staticmethod(chance_of_difference)
    require_measure: ClassVar = staticmethod(Measure.require)
    run_figures: ClassVar = staticmethod(run_figures)
    mean_interval: ClassVar = staticmethod(mean_interval)

    @classmethod
    def from_runs(
        cls, a: Sequence[Path], b: Sequence[Path], measure: str = "tracking",
        margin: tuple[float, str] = (10.0, "%"), unit: str = "sensor", method: str | None = None,
        executor: Executor | None = None, progress: Progress | None = None,
    ) -> Self:  # fmt: skip
        """Compare the runs of two sides.

        measure: of COMPARED_MEASURES. margin: within which the sides count as equal, in % or in the
        measure's unit. unit: "sensor", "gel", "print" or "mounting". method: of the tracker, for
        tracking and time. Raises InputError for a run that names no unit or lacks what the measure
        needs, and as `UnitDifference.from_units` does.
        """
        chosen = Measure.require(measure, margin, "--margin")
        size, relative = margin[0], margin[1] == "%"
        sides = [[open_run(folder) for folder in folders] for folders in (a, b)]
        runs = [run for side in sides for run in side]
        places = [run.folder.resolve() for run in runs]
        if twice := [str(place) for place in places if places.count(place) > 1]:
            raise InputError(f"{twice[0]}: twice; give each run once")
        names = {run.folder: cls.unit_name(run, unit) for run in runs}
        figures = run_figures([*names], measure, method, executor, progress)
        first, second = (
            _side(label, side, names, figures, chosen)
            for label, side in zip(_labels(sides), sides, strict=True)
        )
        noun, compared, notes = unit, (first.units, second.units), [*_notes(sides, names)]
        if len(first.units) == len(second.units) == 1:
            noun, compared = "press", _press_pairs(first, second)
            notes.append(
                f"one {unit} a side: the answer is about {', '.join((*first.units, *second.units))}"
                " only"
            )
        return cls(
            chosen, first, second, UnitDifference.from_units(*compared, relative),
            math.log1p(size / 100) if relative else size, noun, tuple(notes),
        )  # fmt: skip

    @staticmethod
    def unit_name(run: Run, kind: str) -> str:
        """Name of the unit that a run is of; of a mounting with the run's id.

        Serial number and ledger name that of a real run, the draw that of a simulated one. Raises
        InputError for a run that names none.
        """
        serial = run.meta["protocol"].get("specimen", {}).get("serial")
        if run.simulated:
            truth = run.truth()
            if truth is None or truth.sensor is None:
                text = "simulated with the nominal sensor, which is no unit; use `run --sensor N`"
                raise InputError(f"{run.folder}: {text}")
            name = f"sensor {truth.sensor}"
        elif serial is None:
            text = "no unit: its protocol has no specimen.serial, the serial number of the sensor"
            raise InputError(f"{run.folder}: {text}")
        elif kind in ("gel", "print"):
            ledger = SensorLedger.load(serial)
            keys = {"gel": ("gel_batch",), "print": ("printer", "printed")}[kind]
            values = {key: str(getattr(ledger, key)) for key in keys}
            if empty := [key for key, value in values.items() if not value]:
                raise InputError(
                    f"{SensorLedger.file(serial)}: {empty[0]}: needed by --unit {kind}"
                )
            name = " ".join(values.values())
        else:
            name = serial
        return f"{name}, {run.id}" if kind == "mounting" else name

    @property
    def line(self) -> str:
        """Difference with its interval, decision, and what would decide, as a sentence."""
        d, outcome = self.difference, self.difference.outcome(self.margin)
        (low, high), (n, m) = d.interval(), d.counts
        plural = f"{self.noun}es" if self.noun.endswith("s") else f"{self.noun}s"
        names = [side.label for side in (self.a, self.b)]
        if self.noun == "press":
            names = [f"{label} ({next(iter(s.units))})"
                     for label, s in zip(names, (self.a, self.b), strict=True)]  # fmt: skip
        decision = {"a smaller": f"{names[0]} is better", "b smaller": f"{names[1]} is better",
                    "equal": "equal",
                    "undecided": f"not decided; {self._price(plural)}"}  # fmt: skip
        return (
            f"{' - '.join(names)}: {self._show(d.value)} [{self._show(low)} to {self._show(high)}] "
            f"over {f'{n} {plural} of both' if d.paired else f'{n} and {m} {plural}'}: "
            f"{decision[outcome]}. Equal within {self._show(self.margin).lstrip('+')}: "
            f"{'yes' if d.is_equal(self.margin) else 'no'}"
        )

    def _price(self, plural: str) -> str:
        needed = self.difference.units_needed(self.margin)
        if needed is None:
            return f"{MAX_UNITS} {plural} a side would not decide"
        extra = max(needed - min(self.difference.counts), 1)
        noun = plural if extra > 1 else self.noun
        return f"{extra} {noun} more a side would, were this the truth"

    def _show(self, value: float) -> str:
        """Format a difference, one of logarithms as a percentage."""
        if self.difference.relative:
            return f"{100 * math.expm1(value):+.3g} %"
        return f"{value:+.3g} {self.measure.unit}"

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Figure of each unit, in the measure's unit, and the number of its presses."""
        return [
            {"side": side.label, "unit": name, "figure": figure, "presses": len(side.presses[name])}
            for side in (self.a, self.b)
            for name, figure in side.units.items()
        ]

    def as_dict(self) -> dict[str, Any]:
        """Plain data; difference, low, high and margin as shares if relative."""
        d = self.difference
        sizes = {
            "difference": d.value,
            **dict(zip(("low", "high"), d.interval(), strict=True)),
            "margin": self.margin,
        }
        return {
            "verdict": self.line,
            "meaning": self.measure.meaning,
            "unit": self.measure.unit,
            "relative": d.relative,
            **{key: math.expm1(size) if d.relative else size for key, size in sizes.items()},
            "outcome": d.outcome(self.margin),
            "equal": d.is_equal(self.margin),
            "noun": self.noun,
            "paired": d.paired,
            "units_needed": d.units_needed(self.margin),
            "figures": self.rows,
            "notes": list(self.notes),
        }


def _side(
    label: str, runs: Sequence[Run], names: Mapping[Path, str],
    figures: Mapping[Path, PressFigures], measure: Measure,
) -> Side:  # fmt: skip
    """Pool the presses of each unit's runs."""
    presses: dict[str, PressFigures] = {}
    for run in runs:
        part = presses.setdefault(names[run.folder], {})
        for press, figure in figures[run.folder].items():
            part[f"{press} of {run.id}" if press in part else press] = figure
    units = {name: measure.over_presses(part.values()) for name, part in presses.items()}
    return Side(label, units, presses)


def _press_pairs(a: Side, b: Side) -> tuple[PressFigures, PressFigures]:
    """Figures by press of two single units; presses that only one has are not paired."""
    (x,), (y,) = a.presses.values(), b.presses.values()
    if x.keys() == y.keys():
        return x, y
    return {f"a {press}": v for press, v in x.items()}, {f"b {press}": v for press, v in y.items()}


def _labels(sides: Sequence[Sequence[Run]]) -> tuple[str, str]:
    """Names of the pattern or the design that the sides differ in, else a and b."""
    for key in ("pattern", "design"):
        a, b = (
            {Path(str(run.meta["protocol"].get("specimen", {}).get(key))).stem for run in side}
            for side in sides
        )
        if len(a) == len(b) == 1 and a != b:
            return a.pop(), b.pop()
    return "a", "b"


def _notes(sides: Sequence[Sequence[Run]], names: Mapping[Path, str]) -> Iterator[str]:
    """Yield what the difference may hold besides the sides."""
    runs = [run for side in sides for run in side]
    rigs = [", ".join(sorted({str(run.meta.get("rig_name")) for run in side})) for side in sides]
    if rigs[0] != rigs[1]:
        yield f"the sides' rigs differ: {rigs[0]} and {rigs[1]}"
    presses = [
        {tuple(map(str, press.values())) for run in side for press in run.meta.get("presses", [])}
        for side in sides
    ]
    if presses[0] != presses[1]:
        yield "the sides' presses differ"
    references = [[*run.press_roles().values()].count("reference") for run in runs]
    if bare := sum(count < MIN_GROUPS for count in references):
        yield (
            f"{bare} of {len(runs)} runs have under {MIN_GROUPS} reference presses: drift within "
            "them is not taken out"
        )
    if simulated := sum(run.simulated for run in runs):
        yield f"simulated: {simulated} of {len(runs)} runs"
        return
    times = sorted((min(r.begun for r in side), max(r.begun for r in side)) for side in sides)
    if times[0][1] < times[1][0]:
        yield "one side's runs all began first: the difference has the drift of the bench in it"
    for side, label in zip(sides, "ab", strict=True):
        serials = {run.meta["protocol"].get("specimen", {}).get("serial") for run in side}
        batches = {SensorLedger.load(serial).gel_batch for serial in serials}
        if len(serials) > 1 and len(batches) == 1 and batches != {""}:
            yield f"all sensors of {label} are of gel batch {batches.pop()}: one unit"
