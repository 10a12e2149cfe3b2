"""A virtual bench: only what the protocol's channels ask for is built."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..gel.linear.contact import SMALL_STRAIN
from ..optics import Pinhole
from ..patterns.recipe import PatternRecipe
from ..protocols.plan import Protocol
from ..rig.config import RigConfig
from ..rig.force import NetFTSensor
from ..rig.grbl import GrblStage
from ..rig.interface import Camera
from ..rig.runner import Devices
from ..shapes import SensorDimensions
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


def pinhole(sensor: SensorDimensions) -> Pinhole:
    """The camera of a design."""
    optics = sensor.optics
    return Pinhole(
        optics.mm_per_px, optics.image_width_px, optics.image_height_px, sensor.eye_distance_mm
    )


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

    def __init__(
        self,
        config: RigConfig,
        protocol: Protocol,
        sensor: SensorDimensions,
        recipe: PatternRecipe,
        seed: int,
        folder: Path,
    ) -> None:
        """folder: the run folder, where the truth goes."""
        self._protocol = protocol
        self._folder = folder
        self._thickness_mm = sensor.skin.thickness_mm
        self.clock = VirtualClock()
        stage = config.stage
        self.controller = GrblController(
            settings_for(stage.travel_mm, stage.max_feed_mm_min, stage.acceleration_mm_s2),
            self.clock,
        )
        self.presses = Presses(protocol, sensor.skin, config.gel)
        self._choices = [self.presses.choice(path) for path in self.presses.paths]
        drawn = "image" in protocol.channels
        crop = None
        if drawn:
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
        self.camera: VirtualCamera | None = None
        if crop is not None:
            self.camera = self._camera(config, sensor, recipe, seed, crop)
        self.force: VirtualForce | None = None
        if "force" in protocol.channels:
            box = NetFTBox(config.force, self.clock, seed, self.scene.wrenches)
            self.force = VirtualForce(box, self.clock, None if drawn else self.scene)
        # A name of its own, so that several runs can share one process.
        name = f"{folder.name}-{next(_NUMBER)}"
        self._link = connect(self.controller, self.clock, name, baud=stage.baud)
        self.stage = GrblStage(
            self._link.url,
            self.clock,
            stage.frame,
            baud=stage.baud,
            require_travel_mm=stage.travel_mm,
            require_feed_mm_min=stage.max_feed_mm_min,
        )

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

    def left_out(self) -> list[str]:
        """What this scene did not build or solve, and why."""
        lines = []
        if self.camera is None:
            lines.append("camera, picture and printer model: no channel asks for images")
        if self.force is None:
            lines.append("force sensor: the channel 'force' is not asked for")
        if not self.presses.shears and not any(c.friction for c in self._choices):
            lines.append("friction: the channel 'shear' is not asked for")
        if self.presses.level != "hyperelastic":
            lines.append(f"finite-strain gel: the level {self.presses.level!r} is asked for")
        elif not self.presses.fields:
            lines.append("the gel's surface field: no channel asks for images")
        if not self.presses.timed:
            lines.append("viscosity: the specimen has no Prony series")
        lines.append("solid models: a run needs the numbers of the shapes only")
        return lines

    def notes(self) -> list[str]:
        """What a reader of the results must know."""
        presses = self.presses
        opened = presses.opened
        solved = sum(p.solves for p in opened)
        found = sum(len(p.knots) for p in opened if p.found is not None)
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
        limit_mm = SMALL_STRAIN * self._thickness_mm * (1 + 1e-9)
        if presses.level in LINEAR and max(p.box_mm[2] for p in presses.paths) > limit_mm:
            lines.append("WARNING: pressed beyond 10 % of the thickness, past small strain")
        if presses.timed:
            lines.append(
                "the gel's time is the plan's: lines at their feed, rests as long as they settle; "
                "ramps of the stage and the host's delays, some hundredths of a second, are not in"
            )
        return lines + _flag_notes(presses)

    def _camera(
        self,
        config: RigConfig,
        sensor: SensorDimensions,
        recipe: PatternRecipe,
        seed: int,
        crop: LatticeCrop,
    ) -> VirtualCamera:
        from ..imaging import Printer, Sensor
        from ..patterns.raster import albedo
        from .devices import VirtualCamera
        from .picture import Picture, Texture

        printer = Printer(**config.printer.model_dump())
        rng = np.random.default_rng(np.random.SeedSequence([seed, 3]))
        printed = printer.print_(albedo(recipe, printer.mm_per_dot), rng)
        camera = config.camera
        sensor_model = Sensor(
            blur_px=camera.blur_px,
            shading=camera.shading,
            full_well_electrons=camera.full_well_electrons,
            read_noise_electrons=camera.read_noise_electrons,
        )
        picture = Picture(
            pinhole(sensor), crop.lattice, Texture(printed, printer.mm_per_dot), sensor_model
        )
        return VirtualCamera(picture, self.scene, self.clock, seed, crop.lattice, self._folder)


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
        for name, count in press.flags.items():
            where.setdefault(name, []).append(f"{press.name} ({count})")
        for flag in (f for knot in press.knots for f in knot.flags):
            example[flag.partition(":")[0]] = flag
    return [
        f"WARNING: {example[name]}; so or alike at knots of {', '.join(found)}"
        for name, found in sorted(where.items())
    ]


def identity(rig: VirtualRig) -> dict[str, Any]:
    """What the summary keeps of the devices."""
    return {
        "stage": rig.stage.identity(),
        "camera": rig.camera.identity() if rig.camera else None,
        "force": rig.force.identity() if rig.force else None,
    }
