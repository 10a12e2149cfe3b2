"""Report of a plan: its presses, waits, cost, and what it will reach, each with its source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from deltact_fab.bench import SensorLedger
from deltact_fab.common import Check, InputError, Progress, format_duration, write_new_file
from deltact_fab.estimate import Comparison
from deltact_fab.fabricate import load_recipe

from .compare import ComparePlanner
from .force import ForcePlanner
from .mean import ASSUMED_FIGURES, MeanPlanner
from .pilot import SETTLED_SHARE, Pilot
from .planner import (
    REFERENCE_EVERY,
    PlanDesign,
    PlanGoal,
    Planner,
    format_counts,
    format_size,
    protocol_text,
)

RANGE_SHARE = 0.9  # by hand: of the range, below which the gel's depth is what limits the force


@dataclass(frozen=True)
class PlanReport:
    """Report of a plan.

    longer: the smallest design that meets the goal but takes too long, None if there is none.
    ledger_presses: of the sensor so far, None if it has no ledger. files: protocols.
    """

    planner: Planner
    design: PlanDesign
    longer: PlanDesign | None = None
    ledger_presses: int | None = None
    files: Sequence[Path] = ()

    @property
    def lines(self) -> list[str]:
        """Presses, waits and cost, error and chance, then what each rests on."""
        planner, design, goal = self.planner, self.design, self.planner.goal
        prediction, wait_s = design.prediction, planner.settle_s
        middle, low, high = map(format_size, (prediction.error, *prediction.interval))
        tips = ", ".join(planner.tips)
        tips += " only (nobody changes tips)" if goal.unattended else ""
        chance, names = prediction.chance(goal.size), [file.stem for file in self.files]
        lines = [
            f"{', '.join(names) or goal.name}: {tips}; {design.estimate.presses} presses in random "
            f"order: {format_counts(design.counts)}, a reference press every {REFERENCE_EVERY}",
            f"settle {wait_s['press']:.3g} s, after a drag {wait_s['shear']:.3g} s (within "
            f"{SETTLED_SHARE:.0%} of steady: {planner.relaxation[1]}); "
            f"{format_duration(design.estimate.seconds)}, "
            f"{design.estimate.disk_mb / 1000:.2g} GB{self._wear}",
            f"{planner.title}: {middle} {goal.unit} [{low} to {high}]; goal {goal}: chance "
            f"{chance:.2f}",
            *(f"rests on: {line}" for line in planner.basis()),
        ]
        if planner.largest_force_n < RANGE_SHARE * goal.range_n:
            lines.append(
                f"range {goal.range_n:g} N: not with these tips on this gel; "
                f"{planner.largest_force_n:.2g} N is"
            )
        if chance < planner.sure_chance:
            lines.append(planner.nearest(design, self.longer))
        lines += planner.details(design)
        return [*lines, *(f"pilot: {line}" for line in planner.pilot.lines)]

    @property
    def _wear(self) -> str:
        """Presses on the gel before and after, if the sensor has a ledger."""
        count, serial = self.ledger_presses, self.planner.specimen.get("serial")
        if count is None:
            return ""
        return f"; {serial} has {count} presses, then {count + self.design.estimate.presses}"

    def as_dict(self) -> dict[str, Any]:
        """Figures as plain data."""
        planner, design = self.planner, self.design
        promise = planner.promised(design).promise
        assert promise is not None, "just set"
        return {
            **promise.model_dump(mode="json"),
            "tips": list(planner.tips),
            "counts": design.counts,
            "largest_force_n": planner.largest_force_n,
            "settle_s": planner.settle_s,
            "relaxation": planner.relaxation[1],
            "estimate": asdict(design.estimate),
            "components": planner.pilot.components.as_dict(),
            "sure_goal": design.prediction.reached(),
            "goal_met_after_s": None if self.longer is None else self.longer.estimate.seconds,
            "pilot_presses": planner.pilot.presses,
            "ledger_presses": self.ledger_presses,
            "files": [str(file) for file in self.files],
        }


def write_plan(
    file: Path, quantity: str, rig: str, range_n: float, goal: tuple[float, str], time_s: float,
    pilots: Sequence[Path] = (), *, patterns: Sequence[str] = (), tips: Sequence[str] = (),
    specimen: dict[str, str | None] | None = None, unattended: bool = False, seed: int = 0,
    sensors: int | None = None, presses: int | None = None, progress: Progress | None = None,
) -> PlanReport:  # fmt: skip
    """Plan presses for a goal and write their protocol to a new file; see `PlanGoal`.

    quantity: "force", to calibrate, or a measure of `analyze compare`: its mean over the face, or,
    with patterns of two sides, their difference, in a file for each. sensors, presses: a side, and
    on each sensor. Raises InputError for a goal that no plan serves, with the nearest value that
    one does, and for a plan that `protocol check` refuses.
    """
    stems = [f"-{Path(pattern).stem}" for pattern in patterns] or [""]
    files = [file.with_stem(f"{file.stem}{stem}") for stem in stems]
    if len(set(files)) < len(files):
        raise InputError(f"{patterns[0]} and {patterns[1]}: two sides of one name")
    for path in files:
        if path.exists():
            raise InputError(f"-o {path}: already exists; name a new file")
    stated = {key: value for key, value in (specimen or {}).items() if value is not None}
    ledger_presses = None
    if "serial" in stated:
        ledger_presses, recorded = _read_ledger(stated["serial"])
        stated = ({} if recorded is None else {"design": recorded}) | stated
    if patterns:
        stated["pattern"] = patterns[0]
    for pattern in patterns or filter(None, [stated.get("pattern")]):
        load_recipe(pattern)  # refused before anything is solved
    target = PlanGoal(files[0].stem, rig, range_n, *goal, time_s, tuple(tips), stated, unattended,
                      seed)  # fmt: skip
    planner: Planner
    if quantity == "force" and not patterns:
        planner = ForcePlanner(target, Pilot.load(pilots, seed, progress), progress)
    else:
        Comparison.require_measure(quantity, goal, "--difference" if patterns else "--goal")
        kind = ComparePlanner if patterns else MeanPlanner
        assumed = {name: ASSUMED_FIGURES[quantity][name] for name in kind.groups}
        pilot = Pilot.load_figures(
            pilots, quantity, assumed, seed, relative=target.unit == "%", progress=progress
        )
        planner = kind(target, pilot, quantity, *((sensors, presses) if patterns else ()))
    design, longer = planner.plan()
    report = PlanReport(planner, design, longer, ledger_presses, files)
    sides = [planner.redesign(design, path.stem, pattern)
             for path, pattern in zip(files, patterns, strict=False)] or [design]  # fmt: skip
    for path, side in zip(files, sides, strict=True):
        Check.require(planner.checks(side), str(path))
    for path, side in zip(files, sides, strict=True):
        write_new_file(path, protocol_text(planner.promised(side), report.lines))
    return report


def _read_ledger(serial: str) -> tuple[int, str | None]:
    """Return presses and design of a sensor. Raises InputError without a ledger."""
    for row in SensorLedger.list_sensors():
        entry = dict(zip(SensorLedger.COLUMNS, row, strict=True))
        if entry["serial"] == serial:
            if entry["fault"]:
                raise InputError(f"--serial {serial}: {entry['fault']}")
            return int(entry["presses"] or 0), entry["design"]
    raise InputError(
        f"--serial {serial}: no {SensorLedger.file(serial)}; `rig sensors --new {serial}` writes it"
    )
