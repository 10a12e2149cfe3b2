"""Report of a plan: its presses, waits, cost, and what it will reach, each with its source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from deltact_fab.bench import SensorLedger
from deltact_fab.common import Check, InputError, Progress, format_duration, write_new_file

from .force import RANGE_SHARE, REFERENCE_EVERY, ForceDesign, ForceGoal, ForcePlanner, protocol_text
from .pilot import SETTLED_SHARE, Pilot
from .prediction import SURE_CHANCE


@dataclass(frozen=True)
class PlanReport:
    """Report of a plan.

    longer: the smallest design that meets the goal but takes too long, None if there is none.
    ledger_presses: of the sensor so far, None if it has no ledger.
    """

    planner: ForcePlanner
    design: ForceDesign
    longer: ForceDesign | None = None
    ledger_presses: int | None = None

    @property
    def lines(self) -> list[str]:
        """Presses, waits and cost, error and chance, then what each rests on."""
        planner, design, goal = self.planner, self.design, self.planner.goal
        prediction, wait_s = design.prediction, planner.settle_s
        low, high = prediction.interval_n
        tips = ", ".join(planner.tips)
        tips += " only (nobody changes tips)" if goal.unattended else ""
        lines = [
            f"{goal.name}: {tips}; {design.estimate.presses} presses in random order: "
            f"{design.presses} to fit, {len(planner.validation)} only to validate, a reference "
            f"press every {REFERENCE_EVERY}",
            f"settle {wait_s['press']:.3g} s, after a drag {wait_s['shear']:.3g} s (within "
            f"{SETTLED_SHARE:.0%} of steady: {planner.relaxation[1]}); "
            f"{format_duration(design.estimate.seconds)}, "
            f"{design.estimate.disk_mb / 1000:.2g} GB{self._wear}",
            f"normal force, place unseen: {prediction.error_n:.2g} N [{low:.2g} to {high:.2g}]; "
            f"goal {goal.error_n:g} N: chance {prediction.chance(goal.error_n):.2f}",
            *(f"rests on: {line}" for line in planner.basis()),
        ]
        if planner.largest_force_n < RANGE_SHARE * goal.range_n:
            lines.append(
                f"range {goal.range_n:g} N: not with these tips on this gel; "
                f"{planner.largest_force_n:.2g} N is"
            )
        if prediction.chance(goal.error_n) < SURE_CHANCE:
            lines.append(self._nearest)
        if len(planner.tips) == 1:
            lines.append("other tips: not predicted by presses of one tip")
        return [*lines, *(f"pilot: {line}" for line in planner.pilot.lines)]

    @property
    def _wear(self) -> str:
        """Presses on the gel before and after, if the sensor has a ledger."""
        count, serial = self.ledger_presses, self.planner.specimen.get("serial")
        if count is None:
            return ""
        return f"; {serial} has {count} presses, then {count + self.design.estimate.presses}"

    @property
    def _nearest(self) -> str:
        """The nearest goal that can be met, and the time that the goal takes."""
        goal = self.planner.goal
        text = (
            f"goal {goal.error_n:g} N: not with chance {SURE_CHANCE:g} within "
            f"{format_duration(goal.time_s)}; {self.design.prediction.reached_n():.2g} N is"
        )
        if self.longer is not None:
            text += f", or {goal.error_n:g} N in {format_duration(self.longer.estimate.seconds)}"
        elif self.design.prediction.error_n <= goal.error_n:
            text += "; more presses change little, a pilot of more places and presses decides"
        else:
            text += "; more presses change little"
        return text

    @property
    def data(self) -> dict[str, Any]:
        """Figures as plain data."""
        planner, design = self.planner, self.design
        promise = planner.promised(design).promise
        assert promise is not None, "just set"
        return {
            **promise.model_dump(mode="json"),
            "tips": list(planner.tips),
            "fit": design.presses,
            "largest_force_n": planner.largest_force_n,
            "validate": len(planner.validation),
            "settle_s": planner.settle_s,
            "relaxation": planner.relaxation[1],
            "estimate": asdict(design.estimate),
            "components": planner.pilot.components.as_dict(),
            "sure_goal_n": design.prediction.reached_n(),
            "goal_met_after_s": None if self.longer is None else self.longer.estimate.seconds,
            "pilot_presses": planner.pilot.presses,
            "ledger_presses": self.ledger_presses,
        }


def plan_force(
    file: Path, rig: str, range_n: float, goal_n: float, time_s: float,
    pilots: Sequence[Path] = (), *, tips: Sequence[str] = (),
    specimen: dict[str, str | None] | None = None, unattended: bool = False, seed: int = 0,
    progress: Progress | None = None,
) -> PlanReport:  # fmt: skip
    """Plan a force calibration and write its protocol to a new file; see `ForceGoal`.

    Raises InputError for a goal that no plan serves, with the nearest value that one does, and for
    a plan that `protocol check` refuses.
    """
    if file.exists():
        raise InputError(f"-o {file}: already exists; name a new file")
    stated = {key: value for key, value in (specimen or {}).items() if value is not None}
    presses = None
    if "serial" in stated:
        presses, recorded = _read_ledger(stated["serial"])
        stated = ({} if recorded is None else {"design": recorded}) | stated
    goal = ForceGoal(file.stem, rig, range_n, goal_n, time_s, tuple(tips), stated, unattended, seed)
    planner = ForcePlanner(goal, Pilot.load(pilots, seed, progress), progress)
    design, longer = planner.plan()
    Check.require(planner.checks(design), str(file))
    report = PlanReport(planner, design, longer, presses)
    write_new_file(file, protocol_text(planner.promised(design), report.lines))
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
