"""One sensor and gel on a virtual rig: its presses as jobs, and its settings."""

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
"""By hand: cost of a frame on the rig `virtual`, rendered to tracked; for the announced time."""


@dataclass(frozen=True)
class PressScene:
    """Checked protocols of one specimen by name, on a virtual rig; nothing has run yet.

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
        """Build from protocols and their files. Raises InputError, one line, for unusable ones."""
        name = request.rig or STUDY_RIG
        rig, source = load_virtual_rig(name)
        first, *remaining = loaded
        specimen = loaded[first][0].specimen
        for second in remaining:
            if loaded[second][0].specimen != specimen:
                raise InputError(
                    f"{second}: specimen differs from {first}; a calibration is for one sensor"
                )
        sensor, kind = load_design(specimen.design), VirtualKind(rig, source)
        for protocol, file in loaded.values():
            Check.require(check_limits(protocol, sensor, rig.stage), str(file))
            if refused := kind.refusals(protocol, sensor, str(file)):
                raise InputError(refused[0])
        protocols = {key: protocol for key, (protocol, _) in loaded.items()}
        return cls(protocols, rig, name, source, sensor, request.seed)

    def gel(self, name: str) -> Presses:
        """Presses of a protocol on the rig's gel."""
        return Presses(self.protocols[name], self.sensor.skin, self.rig.virtual.gel)

    def presses(self, name: str) -> list[str]:
        """Names of the presses of a protocol, in order."""
        return [path.press for path in self.gel(name).paths]

    def solve_gels(self, request: StudyRequest) -> None:
        """Solve the gel of every press into the store, before the jobs of presses read it.

        A job of a mirror image reads it too. An unsolvable one is stored with the error, which its
        press raises.
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
        """Job of a press of a protocol, its gel solved. cost_s: None for a recorded press.

        arguments: type of the arguments of `work`. extra: further fields of it.
        """
        protocol, presses = self.protocols[name], self.gel(name)
        path = presses.path(press)
        if cost_s is None:
            steps = expand_protocol(protocol)
            cost_s = FRAME_COST_S * sum(step.frames for step in steps if step.press == press)
            extra["recipe"] = load_recipe(protocol.specimen.pattern)
        needs: tuple[str, ...] = ()
        with suppress(DeltactFabError):  # no mesh suffices
            needs = presses.planned_press(path).stored_files
        # A press does not depend on the other indenters: adding some keeps its key. In a list they
        # are numbered together.
        alone = protocol if protocol.press else protocol.narrowed(tips=(path.indenter,))
        if self.rig.camera is not None:
            kind = VirtualKind(self.rig, self.source)
            view, flat = kind.camera(alone, self.sensor), kind.flat(alone)
            extra["rig_file"] = str(self.source.resolve())
            extra["camera"] = None if view is None else view.as_dict()
            extra["flat"] = None if flat is None else hashlib.sha256(flat.to_png()).hexdigest()
        # Only the sensor of a design: other parts do not change the points.
        sensor = SensorDimensions(self.sensor.skin, self.sensor.frame, self.sensor.optics)
        job_data = arguments(alone, sensor, self.rig, press, self.seed, **extra)
        return GridJob(job, work, job_data, cost_s, needs)

    def view(self, name: str) -> SensorModel:
        """Sensor model of a protocol's images."""
        protocol = self.protocols[name]
        camera = VirtualKind(self.rig, self.source).camera(protocol, self.sensor)
        assert camera is not None, "the protocol has images"
        return SensorModel(camera, self.sensor.skin, protocol.specimen.poisson)

    def calibration(
        self, name: str, model: ForceModel, error: dict[str, dict[str, Any]]
    ) -> ForceCalibration:
        """Force calibration from a model fitted to a protocol's points, with its errors."""
        specimen = self.protocols[name].specimen
        recipe = load_recipe(specimen.pattern).model_dump(mode="json")
        sensor = replace(
            self.view(name), recipe=recipe, design=specimen.design, serial=specimen.serial
        )
        return ForceCalibration.from_simulation(name, model, sensor, self.seed, error)

    def settings(self, gel_reports: Sequence[Mapping[str, Any]]) -> dict[str, str]:
        """Settings of the presses in words. gel_reports: reports of the jobs."""
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
            f"{self.rig.virtual.force.noise_n:g} N per sample at {force.rate_hz:g} Hz",
            "gel": f"{specimen.gel_model}; cells below an indenter of {min(cells):.2g} to "
            f"{max(cells):.2g} mm, {hyperelastic.most_unknowns} unknowns at most: the error of the "
            f"mesh may be {times:.2g} times that of the tolerance, "
            f"{times * (1 - Choice.model_share) * hyperelastic.tolerance:.1%} of the force",
        }
        return result | flag_setting(gel_reports, "jobs")


def flag_setting(gel_reports: Sequence[Mapping[str, Any]], noun: str) -> dict[str, str]:
    """Return the setting GEL_FLAGS of a study; empty if no gel was flagged."""
    flags = Counter(name for report in gel_reports for name in report["flags"])
    summary = "; ".join(f"{name} at {n} of {len(gel_reports)} {noun}" for name, n in flags.items())
    return {StudyResult.GEL_FLAGS: summary} if summary else {}


def collect_left_out(gel_reports: Sequence[Mapping[str, Any]]) -> tuple[Note, ...]:
    """Notes on effects that the rig of any job does not model."""
    notes = {note for report in gel_reports for note in report["left_out"]}
    return tuple(sorted(notes, key=lambda note: note.labelled))


def describe_bench(config: VirtualConfig, sensor: SensorDimensions) -> dict[str, str]:
    """Printer and camera in words."""
    p, s = config.virtual.printer, config.virtual.camera
    return {
        "printer": f"{p.dpi} dpi, {p.levels} levels per ink, spread {p.spread_um:g} µm, inks "
        f"misplaced by {p.misregistration_um:g} µm (standard deviation)",
        "camera": f"{sensor.optics.mm_per_px:g} mm per pixel, blur {s.blur_px:g} px, full well "
        f"{s.full_well_electrons:g} electrons, read noise {s.read_noise_electrons:g}, "
        f"shading {s.shading:g}, Bayer mosaic",
    }
