"""One sensor and gel on a virtual rig: its presses as jobs, and what they were made with."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..cad.design import load_design
from ..errors import DeltactFabError, InputError
from ..gel.level_selection import SHARE
from ..measure.force import ForceModel
from ..measure.force.calibration import ForceCalibration
from ..measure.sensor_id import CalibrationSource, Head, SensorModel
from ..patterns.recipe import load_recipe
from ..protocols import limits
from ..protocols.plan import Protocol, expand
from ..report.result import GEL_FLAGS, LeftOut
from ..rig.config import VirtualConfig
from ..shapes import SensorDimensions
from ..version import VERSION
from ..virtual.presolve import solve_ahead
from ..virtual.presses import Presses, path_of, stored_files
from ..virtual.rig import VirtualKind
from . import press_jobs
from .grid import GridJob
from .registry import StudyRequest, virtual_rig

RIG = "virtual"
FRAME_S = 0.25
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
        return cls(protocols, rig, name, source, sensor, asked.seed)

    def gel(self, name: str) -> Presses:
        """The presses of a protocol on the rig's gel."""
        return Presses(self.protocols[name], self.sensor.skin, self.rig.virtual.gel)

    def presses(self, name: str) -> list[str]:
        """The presses of a protocol, in its order."""
        return [path.press for path in self.gel(name).paths]

    def given(self, name: str, press: str, **more: Any) -> dict[str, Any]:
        """Arguments of a job of a press of a protocol; more: of that job alone."""
        protocol, path = self.protocols[name], path_of(self.gel(name), press)
        # A press does not depend on the other indenters: with more of them it is found again.
        alone = protocol.model_copy(update={"indenters": (path.indenter,)})
        more = {"press": press, "seed": self.seed, **more}
        return press_jobs.given(alone, self.sensor, self.rig, self.source, **more)

    def solve_gels(self, asked: StudyRequest) -> None:
        """The gel of every press into the store, where it is not there, before the jobs of presses.

        From there a job of the press has it, that of a mirror image too. One that cannot be solved
        is kept with the reason, which its press raises at once.
        """
        protocols, gel = self.protocols.values(), self.rig.virtual.gel
        solve_ahead(protocols, self.sensor.skin, gel, asked.executor, asked.progress)

    def job(
        self,
        job: str,
        name: str,
        press: str,
        work: Callable[[dict[str, Any]], dict[str, Any]],
        cost_s: float | None = None,
        **more: Any,
    ) -> GridJob:
        """A job of a press of a protocol, its gel solved; cost_s: None for one that is recorded.

        more: besides what the press is and, recorded, the pattern on it.
        """
        if cost_s is None:
            steps = expand(self.protocols[name])
            cost_s = FRAME_S * sum(step.frames for step in steps if step.press == press)
            recipe = load_recipe(self.protocols[name].specimen.pattern)
            more = {"recipe": recipe.model_dump(mode="json"), **more}
        needs: tuple[str, ...] = ()
        with suppress(DeltactFabError):  # no mesh serves it
            presses = self.gel(name)
            needs = stored_files(presses.of(path_of(presses, press)))
        return GridJob(job, work, self.given(name, press, **more), cost_s, needs)

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
        view, specimen = self.view(name), self.protocols[name].specimen
        recipe = load_recipe(specimen.pattern).model_dump(mode="json")
        sensor = replace(view, recipe=recipe, design=specimen.design, serial=specimen.serial).id
        source = CalibrationSource((name,), True, VERSION, self.seed)
        return ForceCalibration(
            Head("force", sensor, source), model, view.skin, view.poisson, error
        )

    def settings(self, gel: Sequence[Mapping[str, Any]]) -> dict[str, str]:
        """What the presses were made with, as a reader is shown it; gel: what jobs report of it."""
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
        return found | flagged(gel, "jobs")


def flagged(gel: Sequence[Mapping[str, Any]], of: str) -> dict[str, str]:
    """The setting GEL_FLAGS of a study; none where no gel was flagged. gel: what jobs report."""
    flags = Counter(name for one in gel for name in one["flags"])
    told = "; ".join(f"{name} at {n} of {len(gel)} {of}" for name, n in flags.items())
    return {GEL_FLAGS: told} if told else {}


def left_out(gel: Sequence[Mapping[str, Any]]) -> tuple[LeftOut, ...]:
    """What the rig did without in any job, from its lines "what: why"."""
    lines = [line.partition(": ") for line in sorted({x for one in gel for x in one["left_out"]})]
    return tuple(LeftOut(what, why) for what, _, why in lines)
