"""A requested run and every check that is possible before a device is opened."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from deltact_fab.bench import (
    GrblKind,
    ImageFormat,
    Protocol,
    RigConfig,
    RigKind,
    RigSetup,
    Run,
    RunEstimate,
    Step,
    check_limits,
    expand_protocol,
    load_protocol,
    load_rig,
    open_run,
)
from deltact_fab.common import Check, InputError, MissingLibrary, Note, Progress, graded
from deltact_fab.fabricate import Design, PatternRecipe, load_design, load_recipe
from deltact_fab.sensor import CameraModel

from ..preflight import peaks, rule

_LOG = logging.getLogger(__name__)


@dataclass
class RunRequest:
    """A protocol on a rig, both by name or path, and how it is to be carried out.

    Every file that it names is read once, here. Raises InputError for one that is of no use; a
    pattern's error is reported by `checks` and `require` with all others.
    """

    protocol_name: str
    rig_name: str
    out: Path = Path()
    """Folder of the run; for checks alone, any on the disk that it will be written to."""
    seed: int = 0
    progress: Progress | None = None
    """Called with the progress of solves and of the run."""
    air: bool = False
    """Nothing goes below the clearance plane, and no force is predicted."""
    unattended: bool = False
    """No prompts: a step that needs an operator is refused."""
    tip_is_clear: bool = False
    """Confirmed by the operator after the position was lost."""
    sensor: int | None = None
    """Number of the sensor that is drawn from the virtual rig's population; None: the nominal."""
    extends: Path | None = None
    """Run that this one extends by more presses on the same sensor."""

    protocol: Protocol = field(init=False)
    source: Path = field(init=False)
    """Path of the protocol."""
    rig: RigConfig = field(init=False)
    rig_path: Path = field(init=False)
    design: Design = field(init=False)
    steps: list[Step] = field(init=False)
    kind: RigKind = field(init=False)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InputError(f"--seed: {self.seed}; expected 0 or more")
        if self.sensor is not None and self.sensor < 0:
            raise InputError(f"--sensor: {self.sensor}; expected 0 or more")
        self.protocol, self.source = load_protocol(self.protocol_name, by_hand=True)
        self.rig, self.rig_path = load_rig(self.rig_name)
        if self.extends is not None:
            self._require_same_specimen(open_run(self.extends))
        self.design = load_design(self.protocol.specimen.design)
        descent_feed = math.inf if self.rig.simulated else self.rig.stage.descent_feed_mm_min
        self.steps = expand_protocol(self.protocol, self.air, descent_feed)
        self.kind = rig_kind(self.rig, self.rig_path, self.sensor)
        if self.protocol.weights is not None and self.rig.kind == "grbl":
            for option in ("unattended", "air"):
                if getattr(self, option):
                    raise InputError(
                        f"--{option}: not available with weights, which are laid on by hand"
                    )

    def _require_same_specimen(self, run: Run) -> None:
        """Raise InputError if the run to extend has another specimen."""
        first, now = run.meta["protocol"]["specimen"], self.protocol.specimen
        for key in ("serial", "design", "pattern"):
            if (old := first.get(key)) != (new := getattr(now, key)):
                text = f"specimen.{key}: {old!r}, but {new!r} in {self.source}"
                raise InputError(f"--extends: {run.folder}: {text}")

    @cached_property
    def recipe(self) -> PatternRecipe:
        """The specimen's pattern. Raises InputError."""
        try:
            return load_recipe(self.protocol.specimen.pattern)
        except InputError as error:
            raise InputError(f"{self.source}: specimen.pattern: {error}") from error

    @cached_property
    def view(self) -> CameraModel | None:
        """Model of the tracked images; None without a camera. Raises InputError."""
        return self.kind.camera(self.protocol, self.design)

    def setup(self, folder: Path) -> RigSetup:
        """Inputs from which a rig is built to record into a folder."""
        return RigSetup(
            self.protocol, self.design, self.recipe, self.view, self.seed, folder, self.air,
            unattended=self.unattended, tip_is_clear=self.tip_is_clear,
        )  # fmt: skip

    @property
    def _touches_face(self) -> bool:
        """True if a stage brings the tip to the face."""
        return not self.air and self.protocol.weights is None

    def estimate(self) -> RunEstimate:
        """Frames, time and disk of the whole run."""
        image_px, rig = rule.image_px(self.view, self.rig), self.rig
        return RunEstimate.from_protocol(
            self.protocol, image_px, rig.stage, self.steps, self.kind.pace(),
            self.kind.change_s(self.protocol) if self._touches_face else 0.0,
        )  # fmt: skip

    def require(self) -> list[Note]:
        """Raise InputError that lists every reason for which the run is refused.

        Returns a warning for each predicted force that is over a limit of the rig or of the plate
        where that breaks nothing, or that may trip the guard.
        """
        Check.require(self._static_rows(), str(self.source))
        forces = None if self.air else self.forces()
        if forces is None:
            return []
        Check.require(forces[1], str(self.rig_path))
        lines = [f"{self.protocol.name}: {row.reason}" for row in forces[1] if row.status == "warn"]
        for line in lines:
            _LOG.warning("warning: %s", line)
        return [Note("forces", line, warns=True) for line in lines]

    def checks(self) -> list[Check]:
        """Return all checks; a run starts if none fails.

        Only a real rig can refuse for its forces, so they are solved for that (minutes, once); for
        a simulated one those that are known already are taken.
        """
        rows = self._static_rows()
        if self.rig.kind == "grbl" and self._touches_face:
            unknown = self.kind.undeclared_lengths(self.protocol)
            status = graded(True, warns=bool(unknown))
            rows.append(Check("tool-lengths", "tool lengths", "unknown", len(unknown), 0, status,
                              tuple(unknown), sign="<="))  # fmt: skip
        # What leaves the gel or the stage is said already, and has no force.
        if not any(row.failed for row in rows) and not self.air:
            prediction = self.forces(solve=not self.rig.simulated)
            rows += [] if prediction is None else prediction[1]
        return rows

    def forces(self, solve: bool = True) -> tuple[list[peaks.Peak], list[Check]] | None:
        """Predicted peaks, and a row for each limit of the rig and of the plate behind the gel.

        None where that would take more than seconds and solve is False. Raises InputError.
        """
        if self.protocol.weights is not None:
            return [], []  # they are the forces
        declared = rule.limits_of(self.rig, str(self.rig_path), self.protocol)
        origin_mm = declared.origin_mm
        loads = peaks.predict_peaks(self.protocol, self.design, origin_mm, self.progress, solve)
        if loads is None:
            return None
        rows = rule.force_checks(loads, declared)
        rows += rule.stop_checks(loads, self.steps, self.rig.stage, declared)
        return loads, rows + rule.plate_checks(loads, self.design, declared.simulated)

    def _static_rows(self) -> list[Check]:
        """All checks but those of the forces, shared by check and run."""
        protocol, design, rig, kind = self.protocol, self.design, self.rig, self.kind
        by_stage = protocol.weights is None
        rows = check_limits(protocol, design, rig.stage, self.steps) if by_stage else []
        rows += rule.resource_checks(protocol, self.steps, rig, self.view, self.out)
        refused = kind.refusals(protocol, design, str(self.source))
        rows.append(Check.refusal("rig", kind.part, refused))
        rows.append(Check.refusal("pattern", "pattern", self._pattern_faults()))
        rows.append(Check.refusal("image-format", "image format", self._format_faults()))
        if rig.kind == "grbl" and self._touches_face:
            lines = kind.unmet_conditions(protocol, design, self.unattended)
            lines = [f"{self.rig_path}: {line}" for line in lines]
            rows.append(Check.refusal("contact", "contact", lines))
        return rows

    def _pattern_faults(self) -> list[str]:
        """Reasons why the specimen's pattern does not suit the protocol."""
        try:
            recipe = self.recipe
        except InputError as error:
            return [str(error)]
        shortfall = self.design.optics.print_shortfall(recipe.printed_mm)
        if "image" in self.protocol.channels and shortfall is not None:
            return [
                f"{self.source}: specimen.pattern: {self.protocol.specimen.pattern!r}: {shortfall}"
            ]
        if "dots" in self.protocol.channels and recipe.dots is None:
            name = self.protocol.specimen.pattern
            return [
                f"{self.source}: channels: 'dots' needs a pattern with dots, not {name!r}; "
                "use one such as 'dense-with-dots', or remove \"dots\""
            ]
        return []

    def _format_faults(self) -> list[str]:
        """Reasons why images cannot be written in the format of the rig file."""
        try:
            ImageFormat.from_meta({"rig": self.rig.recorded()}).require()
        except MissingLibrary as error:
            return [str(error)]
        return []


def rig_kind(rig: RigConfig, source: Path, sensor: int | None = None) -> RigKind:
    """Return the implementation of a rig's kind. No other kind is imported.

    source: of the rig file, from which the paths in it count. sensor: see `RunRequest`. Raises
    InputError.
    """
    if rig.kind == "grbl":
        if sensor is not None:
            raise InputError(f"--sensor: {sensor}; {source} is a real rig, whose sensor is its own")
        return GrblKind(rig, source)
    from ..virtual.rig import VirtualKind

    return VirtualKind(rig, source, sensor)
