"""One sensor, pattern and gel on a virtual rig: its presses as jobs, and their settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from ..cad.design import load_design
from ..errors import InputError
from ..gel.level_selection import SHARE
from ..measure.force import ForceModel
from ..measure.force.calibration import ForceCalibration
from ..measure.sensor_id import CalibrationSource, Head, SensorId
from ..measure.view import SensorView
from ..patterns.recipe import PatternRecipe, load_recipe
from ..protocols import limits
from ..protocols.plan import Protocol, expand
from ..report.result import LeftOut
from ..rig.config import VirtualConfig
from ..shapes import SensorDimensions
from ..version import VERSION
from ..virtual.presses import Presses
from ..virtual.rig import VirtualKind
from . import press_jobs
from .grid import GridJob
from .request import StudyRequest, virtual_rig

RIG = "virtual"
KNOT_S, FRAME_S = 2.0, 0.25
"""What a knot of the gel takes on the rig `virtual`, and a frame: drawn, stored, tracked."""


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
    recipe: PatternRecipe
    seed: int

    @classmethod
    def of(cls, asked: StudyRequest, loaded: Mapping[str, tuple[Protocol, Path]]) -> PressScene:
        """Of protocols and their files. Raises InputError, one line, for what cannot be used."""
        name = asked.rig or RIG
        rig, source = virtual_rig(name)
        first, *others = loaded
        specimen = loaded[first][0].specimen
        for other in others:
            if loaded[other][0].specimen != specimen:
                raise InputError(
                    f"{other}: another specimen than {first} has; a calibration is of one sensor"
                )
        sensor, kind = load_design(specimen.design), VirtualKind(rig, source)
        for protocol, file in loaded.values():
            limits.require(limits.check(protocol, sensor, rig.stage), str(file))
            if refused := kind.refusals(protocol, sensor, str(file)):
                raise InputError(refused[0])
        protocols = {key: protocol for key, (protocol, _) in loaded.items()}
        recipe = load_recipe(specimen.pattern)
        return cls(protocols, rig, name, source, sensor, recipe, asked.seed)

    def gel(self, name: str) -> Presses:
        """The presses of a protocol on the rig's gel."""
        return Presses(self.protocols[name], self.sensor.skin, self.rig.virtual.gel)

    def solve_gels(self, asked: StudyRequest) -> None:
        """The gel of every press that is not in the store, into it, before the jobs of presses."""
        jobs = []
        for name, protocol in self.protocols.items():
            told = partial(press_jobs.given, protocol, self.sensor, self.rig, self.source)
            own = press_jobs.gel_jobs(self.gel(name), told, KNOT_S)
            jobs += [replace(job, name=f"{job.name} of {name}") for job in own]
        press_jobs.solve_gels(asked, jobs)

    def job(
        self,
        job: str,
        name: str,
        presses: Sequence[str],
        work: Callable[[dict[str, Any]], dict[str, Any]],
        **more: Any,
    ) -> GridJob:
        """Presses of a protocol as one job, their gels solved; more: besides what they are."""
        protocol = self.protocols[name]
        given = press_jobs.given(
            protocol, self.sensor, self.rig, self.source,
            recipe=self.recipe.model_dump(mode="json"), presses=list(presses), seed=self.seed,
            **more,
        )  # fmt: skip
        frames = sum(step.frames for step in expand(protocol) if step.press in presses)
        needs = press_jobs.gel_files(self.gel(name), presses)
        return GridJob(job, work, given, FRAME_S * frames, needs)

    def view(self, name: str) -> SensorView:
        """What a protocol's images may tell of the sensor."""
        protocol = self.protocols[name]
        camera = VirtualKind(self.rig, self.source).camera(protocol, self.sensor)
        assert camera is not None, "images are asked for"
        return SensorView(camera, self.sensor.skin, protocol.specimen.poisson)

    def calibration(
        self, name: str, model: ForceModel, error: dict[str, dict[str, Any]]
    ) -> ForceCalibration:
        """A model of force that was fitted to a protocol's points, with its errors there."""
        view, specimen = self.view(name), self.protocols[name].specimen
        recipe = self.recipe.model_dump(mode="json")
        sensor = SensorId.of(view.camera, recipe, specimen.design, specimen.serial)
        source = CalibrationSource((name,), True, VERSION, self.seed)
        return ForceCalibration(
            Head("force", sensor, source), model, view.skin, view.poisson, error
        )

    def settings(self, gel: Sequence[Mapping[str, Any]]) -> dict[str, str]:
        """What the presses were made with, as a reader is shown it; gel: `press_jobs.gel_of`."""
        specimen, force = next(iter(self.protocols.values())).specimen, self.rig.force
        hyperelastic = self.rig.virtual.gel.hyperelastic
        range_n, range_nmm = (
            ", ".join(f"{v:g}" for v in values) for values in (force.range_n, force.range_nmm)
        )
        cells = [cell for one in gel for cell in one["cells_mm"]]
        times = max(one["coarse"] for one in gel) ** 2
        found = {
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
            f"{times * (1 - SHARE) * hyperelastic.tolerance:.1%} of the force",
        }
        return found | press_jobs.flagged(gel, "jobs")


def left_out(gel: Sequence[Mapping[str, Any]]) -> tuple[LeftOut, ...]:
    """What the rig did without in any job, from its lines "what: why"."""
    lines = [line.partition(": ") for line in sorted({x for one in gel for x in one["left_out"]})]
    return tuple(LeftOut(what, why) for what, _, why in lines)
