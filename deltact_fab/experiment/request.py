"""A run as it is asked for, and all that is known of it before a device is opened."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from .. import preflight, record
from ..aliases import Progress
from ..cad.design import load_design
from ..cad.dimensions import Design
from ..errors import InputError, MissingLibrary
from ..patterns.recipe import PatternRecipe, load_recipe
from ..protocols import limits, plan
from ..protocols.motion import LOCKSTEP, SIMULATED, WALL_CLOCK
from ..protocols.plan import Protocol, Step
from ..rig import config as rig_config
from ..rig.config import RigConfig
from ..rig.job import RigKind, RigSetup
from ..rig.tool import requirements


@dataclass
class RunRequest:
    """A protocol on a rig, both by name or path, and how it is to be carried out.

    Every file that it names is read once, here. Raises InputError for one that is of no use; a
    pattern's is told by `checks` and `require` with what else is wrong.
    """

    protocol_name: str
    rig_name: str
    out: Path = Path()
    """Folder of the run; for checks alone, any on the disk that it will be written to."""
    seed: int = 0
    progress: Progress | None = None
    """Told of what is solved, and how far the run is."""
    air: bool = False
    """Nothing goes below the clearance plane, and no force is predicted."""
    realtime: bool = False
    """A virtual rig on the wall clock, in a process of its own behind real wires."""
    unattended: bool = False
    """Nobody is asked anything, and what would need that is refused."""
    tip_is_clear: bool = False
    """The operator's word, where the position is lost."""

    protocol: Protocol = field(init=False)
    source: Path = field(init=False)
    """Of the protocol."""
    rig: RigConfig = field(init=False)
    rig_path: Path = field(init=False)
    design: Design = field(init=False)
    steps: list[Step] = field(init=False)
    kind: RigKind = field(init=False)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InputError(f"--seed: {self.seed}; expected 0 or more")
        self.protocol, self.source = plan.load(self.protocol_name)
        self.rig, self.rig_path = rig_config.load(self.rig_name)
        self.design = load_design(self.protocol.specimen.design)
        self.steps = plan.expand(self.protocol, self.air)
        self.kind = kind_of(self.rig, self.rig_path, self.realtime, self.progress)

    @cached_property
    def recipe(self) -> PatternRecipe:
        """The specimen's pattern. Raises InputError."""
        return load_recipe(self.protocol.specimen.pattern)

    def setup(self, folder: Path) -> RigSetup:
        """What a rig is built from to record into a folder."""
        return RigSetup(
            self.protocol, self.design, self.recipe, self.seed, folder, self.air,
            unattended=self.unattended, tip_is_clear=self.tip_is_clear,
        )  # fmt: skip

    def estimate(self) -> limits.RunEstimate:
        """Frames, time and disk of the whole run."""
        pace = (SIMULATED if self.realtime else LOCKSTEP) if self.rig.simulated else WALL_CLOCK
        image_px = preflight.image_px(self.protocol, self.design, self.rig, self.kind)
        return limits.estimate(self.protocol, image_px, self.rig.stage.box, self.steps, pace)

    def require(self) -> None:
        """Raise InputError for all that a run is refused for but its forces, see `warnings`."""
        limits.require(self._rows(), str(self.source))

    def checks(self) -> list[limits.LimitCheck]:
        """Every check: a run begins where all are ok.

        Only a real rig can refuse for its forces, so they are solved for that (minutes, once); for
        a simulated one those that are known already are taken.
        """
        rows = self._rows()
        if self.rig.kind == "grbl" and not self.air:
            unknown = requirements.undeclared_lengths(self.rig, self.protocol)
            what, where = "unknown", "; ".join(unknown)
            rows.append(
                limits.LimitCheck("tool lengths", True, what, len(unknown), 0, where, bool(unknown))
            )
        # What leaves the gel or the stage is said already, and has no force.
        if all(row.ok for row in rows) and not self.air:
            declared = self._force_limits()
            peaks = self._peaks(declared, solve=not self.rig.simulated)
            if peaks is not None:
                rows += preflight.checks(peaks, declared)
                rows += preflight.plate_checks(peaks, self.design, declared.simulated)
        return rows

    def forces(self, solve: bool = True) -> tuple[list[preflight.Peak], list[str]] | None:
        """Predicted peaks, and what the rig says to them, one line each.

        None where that would take more than seconds and solve is False. Raises InputError.
        """
        declared = self._force_limits()
        peaks = self._peaks(declared, solve)
        if peaks is None:
            return None
        breaks, remarks = self._judge(peaks, declared)
        return peaks, breaks + remarks

    def warnings(self) -> list[str]:
        """Predicted forces beyond the rig's limits or the plate's, or that may trip the guard.

        A line each. Raises InputError on a real rig for what would break something.
        """
        if self.air:
            return []
        declared = self._force_limits()
        peaks = self._peaks(declared)
        assert peaks is not None
        breaks, remarks = self._judge(peaks, declared)
        found = preflight.require(breaks, declared)
        found += preflight.may_trip(self.protocol.name, peaks, declared) + remarks
        return [f"WARNING: {line}" for line in found]

    def _rows(self) -> list[limits.LimitCheck]:
        """Every check but that of the forces; check and run ask it alone."""
        protocol, design, rig, kind = self.protocol, self.design, self.rig, self.kind
        wall_clock = self.realtime or not rig.simulated
        rows = limits.check(protocol, design, rig.stage.box, self.steps)
        rows += preflight.needs(protocol, design, self.steps, rig, kind, self.out, wall_clock)
        refused = kind.refusals(protocol, design, str(self.source))
        rows.append(limits.refusals(kind.part, refused))
        rows.append(limits.refusals("pattern", self._pattern()))
        rows.append(limits.refusals("image format", self._format()))
        if rig.kind == "grbl" and not self.air:
            unmet = requirements.unmet(rig, protocol, design, self.unattended)
            rows.append(limits.refusals("contact", [f"{self.rig_path}: {line}" for line in unmet]))
        return rows

    def _pattern(self) -> list[str]:
        """Why the specimen's pattern does not serve the protocol."""
        try:
            recipe = self.recipe
        except InputError as why:
            return [f"{self.source}: specimen.pattern: {why}"]
        if "dots" in self.protocol.channels and recipe.dots is None:
            name = self.protocol.specimen.pattern
            return [
                f"{self.source}: channels: 'dots' asked for, and the pattern {name!r} has none; "
                "take one with dots, as 'dense-with-dots', or remove \"dots\""
            ]
        return []

    def _format(self) -> list[str]:
        """Why images cannot be written as the rig's camera has it."""
        try:
            record.require_format(record.image_format({"rig": self.rig.recorded()}))
        except MissingLibrary as why:
            return [str(why)]
        return []

    def _force_limits(self) -> preflight.ForceLimits:
        return preflight.limits_of(self.rig, str(self.rig_path), self.protocol, self.realtime)

    def _peaks(
        self, declared: preflight.ForceLimits, solve: bool = True
    ) -> list[preflight.Peak] | None:
        return preflight.predict(
            self.protocol, self.design, declared.origin_mm, self.progress, solve
        )

    def _judge(
        self, peaks: list[preflight.Peak], declared: preflight.ForceLimits
    ) -> tuple[list[str], list[str]]:
        """Lines of what would break rig or plate, and of what is only worth knowing."""
        name = self.protocol.name
        lines = preflight.judge(name, self.design.skin.thickness_mm, peaks, declared)
        breaks, remarks = preflight.judge_plate(name, peaks, self.design)
        return lines + breaks, remarks


def kind_of(
    rig: RigConfig, source: Path, realtime: bool = False, progress: Progress | None = None
) -> RigKind:
    """What a kind of rig says and builds. Only the one that is asked for is imported.

    source: of the rig file, from which the paths in it count. realtime: a virtual rig on the wall
    clock and real wires. progress: hears of what is solved before that. Raises InputError.
    """
    if rig.kind == "grbl":
        from ..rig.bench import GrblKind

        if realtime:
            raise InputError(f"{source}: --realtime is for a virtual rig; this one is real")
        return GrblKind(rig, source)
    if realtime:
        from ..virtual.realtime.rig import RealtimeKind

        return RealtimeKind(rig, source, progress)
    from ..virtual.rig import VirtualKind

    return VirtualKind(rig, source)
