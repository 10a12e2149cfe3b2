"""A virtual bench: only what the protocol's channels ask for is built."""

from __future__ import annotations

import itertools
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import numpy as np

from ..gel.linear.contact import SMALL_STRAIN
from ..optics import Pinhole
from ..protocols.plan import Protocol
from ..rig.config import VirtualConfig
from ..rig.force import NetFTSensor
from ..rig.grbl import GrblStage
from ..rig.interface import Camera, Devices, Job
from ..shapes import SensorDimensions
from .answerable import unanswered
from .clock import VirtualClock
from .controller import GrblController
from .grbl_settings import settings_for
from .netft import NetFTBox
from .presses import LINEAR, Presses
from .scene import GelScene, LatticeCrop
from .streams import stream_number
from .wire import connect

if TYPE_CHECKING:
    from .devices import VirtualCamera

_NUMBER = itertools.count(1)
_LEVEL_NOTES = {
    "layer": [
        "the layer level ignores the free sides of the block and large strain: its in-plane "
        "motion is off by some tenths of a millimetre from 2 mm of depth on"
    ],
    "block": [
        "the block level ignores large strain: its in-plane motion is off by some tenths of a "
        "millimetre from 2 mm of depth on"
    ],
    "hyperelastic": [],
}


class VirtualKind:
    """Implements rig.interface.RigKind."""

    part = "simulated gel"

    def __init__(self, config: VirtualConfig) -> None:
        self._config = config

    def refusals(self, protocol: Protocol, sensor: SensorDimensions, source: str) -> list[str]:
        """Presses that are observed and for which the gel has no level or no mesh."""
        return unanswered(protocol, sensor, self._config.virtual.gel, source)

    def camera(self, sensor: SensorDimensions) -> Pinhole:
        """The camera of the design."""
        return Pinhole.of(sensor)

    def build(self, job: Job) -> VirtualRig:
        """Everything below the wire that the protocol asks for, and the drivers above it."""
        return VirtualRig(self._config, job)


class VirtualForce(NetFTSensor):
    """The real client on the simulated box; a press starts its noise anew."""

    def __init__(self, box: NetFTBox, clock: VirtualClock, scene: GelScene | None) -> None:
        """scene: told of a new press when no camera does that."""
        super().__init__(box, clock)
        self._box = box
        self._scene = scene

    def begin(self, stream: str) -> None:
        """Re-seed, then tare as the real client does."""
        self._box.reseed(stream_number(stream))
        if self._scene is not None:
            self._scene.begin()
        super().begin(stream)


class VirtualRig:
    """Clock, controller behind its wire, gel, camera and force box of one run."""

    def __init__(self, config: VirtualConfig, job: Job) -> None:
        self._job = job
        self._config = config
        self._open = ExitStack()
        try:
            self._build()
        except BaseException:
            self.close()
            raise

    def _build(self) -> None:
        """Each device that is built is closed with the rig, the last one first."""
        job, stage, simulator = self._job, self._config.stage, self._config.virtual
        channels, sensor = job.protocol.channels, job.sensor
        self.clock = VirtualClock()
        self.controller = GrblController(
            settings_for(stage.travel_mm, stage.max_feed_mm_min, stage.acceleration_mm_s2),
            self.clock,
        )
        self.presses = Presses(job.protocol, sensor.skin, simulator.gel)
        paths = self.presses.paths if self.presses.observed else ()
        self._choices = [self.presses.choice(path) for path in paths]
        crop = None
        if "image" in channels:
            from .picture import MARGIN_PX

            view = sensor.optics.view_mm
            margin_mm = MARGIN_PX * sensor.optics.mm_per_px
            crop = LatticeCrop(
                *self.presses.axes_mm(), (view[0] / 2 + margin_mm, view[1] / 2 + margin_mm)
            )
        self.scene = GelScene(
            self.controller,
            self.clock,
            stage.frame,
            self.presses.increments,
            self.presses.open,
            crop,
            self.presses.modulus_mpa,
        )
        # A name of its own, so that several runs can share one process.
        name = f"{job.folder.name}-{next(_NUMBER)}"
        self._link = connect(self.controller, self.clock, name, baud=stage.baud)
        self.stage = GrblStage(
            self._link.url,
            self.clock,
            stage.frame,
            baud=stage.baud,
            require_travel_mm=stage.travel_mm,
            require_feed_mm_min=stage.max_feed_mm_min,
        )
        self._open.callback(self.stage.close)
        self.camera: VirtualCamera | None = None
        if crop is not None:
            self.camera = self._camera(crop)
            self._open.callback(self.camera.close)
        self.force: VirtualForce | None = None
        if "force" in channels:
            box = NetFTBox(
                self._config.force,
                self.clock,
                job.seed,
                self.scene.wrenches,
                simulator.force.noise_n,
            )
            self.force = VirtualForce(box, self.clock, self.scene if crop is None else None)
            self._open.callback(self.force.close)

    def devices(self) -> Devices:
        """What the runner drives."""
        camera: Camera | None = self.camera
        return Devices(
            clock=self.clock,
            stage=self.stage,
            camera=camera,
            force=self.force,
            change_indenter=self.scene.mount,
        )

    def identity(self) -> dict[str, Any]:
        """What the summary keeps of the devices."""
        return {
            "stage": self.stage.identity(),
            "camera": self.camera.identity() if self.camera else None,
            "force": self.force.identity() if self.force else None,
        }

    def close(self) -> None:
        """Close what was built; again does nothing."""
        self._open.close()

    def left_out(self) -> list[str]:
        """What this scene did not build or solve, and why."""
        lines = []
        if self.camera is None:
            lines.append("camera, picture and printer model: no channel asks for images")
        if self.force is None:
            lines.append("force sensor: the channel 'force' is not asked for")
        lines += self._gel_left_out()
        lines.append("solid models: a run needs the numbers of the shapes only")
        return lines

    def _gel_left_out(self) -> list[str]:
        presses, lines = self.presses, []
        if not presses.observed:
            return ["gel: no channel asks for what it does"]
        if not presses.shears and not any(c.friction for c in self._choices):
            lines.append("friction: the channel 'shear' is not asked for")
        if presses.level != "hyperelastic":
            lines.append(f"finite-strain gel: the level {presses.level!r} is asked for")
        elif not presses.fields:
            lines.append("the gel's surface field: no channel asks for images")
        if not presses.tractions:
            lines.append("the face's tractions: the channel 'traction' is not asked for")
        if not presses.timed:
            lines.append("viscosity: the specimen has no Prony series")
        return lines

    def notes(self) -> list[str]:
        """What a reader of the results must know."""
        presses = self.presses
        if self._job.air or not presses.observed:
            return []
        opened = presses.opened
        solved = sum(p.solver.solves for p in opened)
        found = sum(len(p.solver.knots) for p in opened if p.solver.found is not None)
        lines = [
            f"{solved} contact problems solved, {found} found in the store (no pattern, camera or "
            "modulus matters to them); between them displacements and forces are interpolated "
            f"linearly{_bound(presses)}"
        ]
        lines += _LEVEL_NOTES[presses.level]
        lines += dict.fromkeys(f"gel: {choice.why}" for choice in self._choices)
        if not presses.shears and any(c.friction for c in self._choices):
            lines.append("friction is solved, for it changes the force of these presses")
        # From the plan, for the presses that a resumed run kept are not solved again.
        limit_mm = SMALL_STRAIN * self._job.sensor.skin.thickness_mm * (1 + 1e-9)
        if presses.level in LINEAR and max(p.box_mm[2] for p in presses.paths) > limit_mm:
            lines.append("WARNING: pressed beyond 10 % of the thickness, past small strain")
        if presses.timed:
            lines.append(
                "the gel's time is the plan's: lines at their feed, rests as long as they settle; "
                "ramps of the stage and the host's delays, some hundredths of a second, are not in"
            )
        return lines + _flag_notes(presses)

    def _camera(self, crop: LatticeCrop) -> VirtualCamera:
        from ..imaging import Printer, Sensor
        from ..patterns.raster import albedo
        from .devices import VirtualCamera
        from .picture import Picture, Texture

        job, simulator = self._job, self._config.virtual
        printer = Printer(**simulator.printer.model_dump())
        rng = np.random.default_rng(np.random.SeedSequence([job.seed, 3]))
        printed = printer.print_(albedo(job.recipe, printer.mm_per_dot), rng)
        picture = Picture(
            Pinhole.of(job.sensor),
            crop.lattice,
            Texture(printed, printer.mm_per_dot),
            Sensor(**simulator.camera.model_dump()),
        )
        return VirtualCamera(picture, self.scene, self.clock, job.seed, crop.lattice, job.folder)


def _bound(presses: Presses) -> str:
    """What linear interpolation costs, as far as it was tried."""
    between = presses.between
    if between.samples == 0:
        return ""
    parts = [f"{presses.modulus_mpa * between.force_n:.2g} N"]
    if presses.fields:
        parts.insert(0, f"{between.displacement_mm:.2g} mm in plane")
    failed = f"; {between.failed} did not converge" if between.failed else ""
    return (
        f": half-way between knots off by at most {' and '.join(parts)} ({between.samples} "
        f"intervals solved half-way{failed})"
    )


def _flag_notes(presses: Presses) -> list[str]:
    """One line for each kind of flag: where, at how many knots, and the last of them in full."""
    where: dict[str, list[str]] = {}
    example: dict[str, str] = {}
    for press in presses.opened:
        for name, count in press.solver.flags.items():
            where.setdefault(name, []).append(f"{press.name} ({count})")
        for flag in (f for knot in press.solver.knots for f in knot.flags):
            example[flag.partition(":")[0]] = flag
    return [
        f"WARNING: {example[name]}; so or alike at knots of {', '.join(found)}"
        for name, found in sorted(where.items())
    ]
