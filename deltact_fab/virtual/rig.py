"""A virtual bench: only what the protocol's channels ask for is built."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..gel.contact import DEPTH_LIMIT, SMALL_STRAIN, LayerContact
from ..gel.layer import BondedLayer
from ..gel.material import GelMaterial
from ..optics import Pinhole
from ..patterns.recipe import PatternRecipe
from ..protocols.plan import Protocol
from ..rig.config import RigConfig
from ..rig.force import NetFTSensor
from ..rig.grbl import GrblStage
from ..rig.interface import Camera
from ..rig.runner import Devices
from ..shapes import SensorDimensions
from ..shapes.indenter import parse as parse_indenter
from .clock import VirtualClock
from .controller import GrblController, settings_for
from .netft import NetFTBox
from .scene import GelScene, LatticeCrop
from .streams import stream_number
from .wire import connect

if TYPE_CHECKING:
    from .devices import VirtualCamera

_NUMBER = itertools.count(1)
PADDING = 3.0  # periods of the skin; the layer's own error is below .05 % there


def pinhole(sensor: SensorDimensions) -> Pinhole:
    """The camera of a design."""
    optics = sensor.optics
    return Pinhole(
        optics.mm_per_px, optics.image_width_px, optics.image_height_px, sensor.eye_distance_mm
    )


def require_gel_level(protocol: Protocol, sensor: SensorDimensions, source: str) -> None:
    """Refuse depths that the protocol's gel level cannot answer for. Raises InputError."""
    limit_mm = DEPTH_LIMIT * sensor.skin.thickness_mm
    deepest = max(protocol.depths_mm)
    if deepest > limit_mm:
        raise InputError(
            f"{source}: depths_mm: {deepest:g} mm is over {limit_mm:g} mm, 25 % of the gel: the "
            "linear level 'layer' stops there; this protocol needs the level 'hyperelastic'"
        )
    for indenter in map(parse_indenter, protocol.indenters):
        if deepest >= indenter.equator_mm:
            raise InputError(
                f"{source}: depths_mm: {deepest:g} mm presses {indenter.name} to where its sides "
                f"turn vertical, at {indenter.equator_mm:g} mm: the level 'layer' reaches below "
                "that; this protocol needs the level 'hyperelastic'"
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
        self._deepest_mm = max(protocol.depths_mm)
        self._friction_solved = "shear" in protocol.channels
        self.clock = VirtualClock()
        stage = config.stage
        self.controller = GrblController(
            settings_for(stage.travel_mm, stage.max_feed_mm_min, stage.acceleration_mm_s2),
            self.clock,
        )
        specimen = protocol.specimen
        material = GelMaterial(specimen.modulus_mpa, specimen.poisson, specimen.friction)
        self._layer = BondedLayer.for_skin(
            sensor.skin, material, spacing_mm=config.gel.spacing_mm, padding=PADDING
        )
        drawn = "image" in protocol.channels
        crop = None
        if drawn:
            from .picture import MARGIN_PX

            view = sensor.optics.view_mm
            margin_mm = MARGIN_PX * sensor.optics.mm_per_px
            crop = LatticeCrop(
                self._layer.x_mm,
                self._layer.y_mm,
                (view[0] / 2 + margin_mm, view[1] / 2 + margin_mm),
            )
        self.scene = GelScene(self.controller, self.clock, stage.frame, config.gel, crop)
        self.camera: VirtualCamera | None = None
        if crop is not None:
            self.camera = self._camera(config, sensor, recipe, seed, crop)
        self.force: VirtualForce | None = None
        if "force" in protocol.channels:
            box = NetFTBox(config.force, self.clock, seed, lambda: self.scene.observe().wrench())
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
            change_indenter=self._mount,
        )

    def left_out(self) -> list[str]:
        """What this scene did not build or solve, and why."""
        lines = []
        if self.camera is None:
            lines.append("camera, picture and printer model: no channel asks for images")
        if self.force is None:
            lines.append("force sensor: the channel 'force' is not asked for")
        if not self._friction_solved:
            lines.append("friction: the channel 'shear' is not asked for")
        lines.append("finite-strain gel: the level 'layer' is asked for")
        lines.append("viscosity: the specimen has no Prony series")
        lines.append("solid models: a run needs the numbers of the shapes only")
        return lines

    def notes(self) -> list[str]:
        """What a reader of the results must know."""
        lines = [
            f"{self.scene.solves} contact problems solved; between them displacements and forces "
            "are interpolated linearly",
            "the layer level ignores the free sides of the block and large strain: its in-plane "
            "motion is off by some tenths of a millimetre from 2 mm of depth on",
        ]
        # From the plan, for the presses that a resumed run kept are not solved again.
        if self._deepest_mm > SMALL_STRAIN * self._layer.thickness_mm * (1 + 1e-9):
            lines.append("WARNING: pressed beyond 10 % of the thickness, past small strain")
        return lines

    def _mount(self, name: str) -> None:
        contact = LayerContact(
            self._layer,
            parse_indenter(name),
            friction=self._protocol.specimen.friction,
            observe_shear=self._friction_solved,
        )
        self.scene.mount(contact)

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


def identity(rig: VirtualRig) -> dict[str, Any]:
    """What the summary keeps of the devices."""
    return {
        "stage": rig.stage.identity(),
        "camera": rig.camera.identity() if rig.camera else None,
        "force": rig.force.identity() if rig.force else None,
    }
