"""One sensor and gel on a virtual rig: its presses as jobs, and what they were made with."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from deltact_fab.bench import Protocol, VirtualConfig, check_limits, expand_protocol
from deltact_fab.common import Check, DeltactFabError, InputError, Note
from deltact_fab.estimate import ForceCalibration, ForceModel, SensorModel
from deltact_fab.fabricate import load_design, load_recipe
from deltact_fab.physics import Choice
from deltact_fab.present import StudyResult
from deltact_fab.sensor import SensorDimensions
from deltact_fab.simulate import Presses, VirtualKind, solve_presses

from .grid import GridJob
from .press_jobs import PressJob
from .registry import StudyRequest, load_virtual_rig

STUDY_RIG = "virtual"
FRAME_COST_S = 0.25
"""What a frame takes on the rig `virtual`: drawn, stored, tracked."""


@dataclass(frozen=True)
class PressScene:
    """Protocols of one specimen by name, on a virtual rig, checked; nothing has run yet.

    source: of the rig file.
    """

    protocols: dict[str, Protocol]
    rig: VirtualConfig
    rig_name: str
    source: Path
    sensor: SensorDimensions
    seed: int

    @classmethod
    def load(cls, request: StudyRequest, loaded: Mapping[str, tuple[Protocol, Path]]) -> PressScene:
        """Of protocols and their files. Raises InputError, one line, for what cannot be used."""
        name = request.rig or STUDY_RIG
        rig, source = load_virtual_rig(name)
        first, *remaining = loaded
        specimen = loaded[first][0].specimen
        for second in remaining:
            if loaded[second][0].specimen != specimen:
                raise InputError(
                    f"{second}: another specimen than {first} has; a calibration is of one sensor"
                )
        sensor, kind = load_design(specimen.design), VirtualKind(rig, source)
        for protocol, file in loaded.values():
            Check.require(check_limits(protocol, sensor, rig.stage), str(file))
            if refused := kind.refusals(protocol, sensor, str(file)):
                raise InputError(refused[0])
        protocols = {key: protocol for key, (protocol, _) in loaded.items()}
        return cls(protocols, rig, name, source, sensor, request.seed)

    def gel(self, name: str) -> Presses:
        """The presses of a protocol on the rig's gel."""
        return Presses(self.protocols[name], self.sensor.skin, self.rig.virtual.gel)

    def presses(self, name: str) -> list[str]:
        """The presses of a protocol, in its order."""
        return [path.press for path in self.gel(name).paths]

    def solve_gels(self, request: StudyRequest) -> None:
        """The gel of every press into the store, where it is not there, before the jobs of presses.

        From there a job of the press has it, that of a mirror image too. One that cannot be solved
        is kept with the reason, which its press raises at once.
        """
        protocols, gel = self.protocols.values(), self.rig.virtual.gel
        solve_presses(protocols, self.sensor.skin, gel, request.executor, request.progress)

    def job(
        self,
        job: str,
        name: str,
        press: str,
        work: Callable[[Any], dict[str, Any]],
        arguments: type[PressJob],
        cost_s: float | None = None,
        **extra: Any,
    ) -> GridJob:
        """A job of a press of a protocol, its gel solved; cost_s: None for one that is recorded.

        arguments: the type of those of `work`. more: of them, besides what the press is and,
        recorded, the pattern on it.
        """
        protocol, presses = self.protocols[name], self.gel(name)
        path = presses.path(press)
        if cost_s is None:
            steps = expand_protocol(protocol)
            cost_s = FRAME_COST_S * sum(step.frames for step in steps if step.press == press)
            extra["recipe"] = load_recipe(protocol.specimen.pattern)
        needs: tuple[str, ...] = ()
        with suppress(DeltactFabError):  # no mesh serves it
            needs = presses.of(path).stored_files
        # A press does not depend on the other indenters: with more of them it is found again.
        alone = protocol.model_copy(update={"indenters": (path.indenter,)})
        if self.rig.camera is not None:
            kind = VirtualKind(self.rig, self.source)
            view, flat = kind.camera(alone, self.sensor), kind.flat(alone)
            extra["rig_file"] = str(self.source.resolve())
            extra["camera"] = None if view is None else view.as_dict()
            extra["flat"] = None if flat is None else hashlib.sha256(flat.png()).hexdigest()
        # Of a design no more than a sensor is: what is built around it changes no point.
        sensor = SensorDimensions(self.sensor.skin, self.sensor.frame, self.sensor.optics)
        job_data = arguments(alone, sensor, self.rig, press, self.seed, **extra)
        return GridJob(job, work, job_data, cost_s, needs)

    def view(self, name: str) -> SensorModel:
        """What a protocol's images may tell of the sensor."""
        protocol = self.protocols[name]
        camera = VirtualKind(self.rig, self.source).camera(protocol, self.sensor)
        assert camera is not None, "images are asked for"
        return SensorModel(camera, self.sensor.skin, protocol.specimen.poisson)

    def calibration(
        self, name: str, model: ForceModel, error: dict[str, dict[str, Any]]
    ) -> ForceCalibration:
        """A model of force that was fitted to a protocol's points, with its errors there."""
        specimen = self.protocols[name].specimen
        recipe = load_recipe(specimen.pattern).model_dump(mode="json")
        sensor = replace(
            self.view(name), recipe=recipe, design=specimen.design, serial=specimen.serial
        )
        return ForceCalibration.from_simulation(name, model, sensor, self.seed, error)

    def settings(self, gel_reports: Sequence[Mapping[str, Any]]) -> dict[str, str]:
        """What the presses were made with, as a reader is shown it; gel: what jobs report of it."""
        specimen, force = next(iter(self.protocols.values())).specimen, self.rig.force
        hyperelastic = self.rig.virtual.gel.hyperelastic
        range_n, range_nmm = (
            ", ".join(f"{v:g}" for v in values) for values in (force.range_n, force.range_nmm)
        )
        cells = [cell for report in gel_reports for cell in report["cells_mm"]]
        times = max(report["coarse"] for report in gel_reports) ** 2
        result = {
            "rig": self.rig_name,
            "pattern": specimen.pattern,
            "friction": f"{specimen.friction:g}",
            "modulus": f"{specimen.modulus_mpa:g} MPa, known to a factor of 2; Poisson's ratio "
            f"{specimen.poisson:g}",
            "force sensor": f"range {range_n} N and {range_nmm} N mm, noise "
            f"{self.rig.virtual.force.noise_n:g} N a sample at {force.rate_hz:g} Hz",
            "gel": f"{specimen.gel_model}; cells below an indenter of {min(cells):.2g} to "
            f"{max(cells):.2g} mm, {hyperelastic.most_unknowns} unknowns at most: the error of the "
            f"mesh may be {times:.2g} times that of the tolerance, "
            f"{times * (1 - Choice.model_share) * hyperelastic.tolerance:.1%} of the force",
        }
        return result | flag_setting(gel_reports, "jobs")


def flag_setting(gel_reports: Sequence[Mapping[str, Any]], noun: str) -> dict[str, str]:
    """The setting GEL_FLAGS of a study; none where no gel was flagged. gel: what jobs report."""
    flags = Counter(name for report in gel_reports for name in report["flags"])
    summary = "; ".join(f"{name} at {n} of {len(gel_reports)} {noun}" for name, n in flags.items())
    return {StudyResult.GEL_FLAGS: summary} if summary else {}


def collect_left_out(gel_reports: Sequence[Mapping[str, Any]]) -> tuple[Note, ...]:
    """What the rig did without in any job."""
    notes = {note for report in gel_reports for note in report["left_out"]}
    return tuple(sorted(notes, key=lambda note: note.labelled))
