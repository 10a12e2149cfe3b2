"""A virtual bench: only what the protocol's channels ask for is built."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deltact_fab.bench import (
    GrblStage,
    NetFTSensor,
    Protocol,
    Rig,
    RigKind,
    RigSetup,
    VirtualConfig,
)
from deltact_fab.common import Note, Progress
from deltact_fab.sensor import Fisheye, Pinhole, Rectified, SensorDimensions

from .clock import VirtualClock
from .controller import GrblController
from .drift import Drift
from .netft import LockstepLink, NetFTBox
from .population import SensorDraw
from .presses import Presses, gel_not_built, gel_notes, simulation_refusals
from .scene import GelScene, LatticeCrop
from .wire import SerialLink

if TYPE_CHECKING:
    from deltact_fab.physics import Choice

    from .drawing import VirtualCamera
    from .picture import FrameRenderer


class VirtualKind(RigKind):
    """The kind of rig that is simulated whole: its camera, its refusals, and how it is built."""

    part = "simulated gel"
    _config: VirtualConfig

    def __init__(self, config: VirtualConfig, source: Path, number: int | None = None) -> None:
        """number: of the sensor that is drawn from the rig's population; None: the nominal one."""
        super().__init__(config, source)
        self._draw = SensorDraw.from_population(config, number, str(source))

    def refusals(self, protocol: Protocol, sensor: SensorDimensions, source: str) -> list[str]:
        """Presses that are observed and for which the gel has no level or no mesh."""
        gel, draw = self._config.virtual.gel, self._draw
        lines = simulation_refusals(protocol, sensor, gel, source)
        if draw.number is not None and not lines:
            source = f"{source}: sensor {draw.number} of [virtual.population]"
            sensor = SensorDimensions(draw.skin(sensor.skin))
            lines = simulation_refusals(draw.protocol(protocol), sensor, gel, source)
        return lines

    def camera(self, protocol: Protocol, sensor: SensorDimensions) -> Pinhole | Rectified | None:
        """The design's pinhole, or the view through the lens; that only where images are taken."""
        view: Pinhole | Rectified = Pinhole.from_sensor(sensor)
        if self._config.virtual.lens is not None:
            if "image" not in protocol.channels:
                return None
            from .lens import tracked_view

            view = tracked_view(self._config, sensor, self._source)
        if self._draw.number is not None and "image" in protocol.channels:
            from .lens import true_camera

            true_camera(self._config, sensor, view, self._draw)  # refused before the run begins
        return view

    def truth(self, protocol: Protocol, sensor: SensorDimensions) -> dict[str, Any] | None:
        """The drawn sensor and the drift, of a rig that has either."""
        simulator = self._config.virtual
        if simulator.population is None and simulator.drift is None:
            return None
        drift = None if simulator.drift is None else simulator.drift.model_dump()
        return {**self._draw.truth(protocol, sensor.skin), "drift": drift}

    def build(self, job: RigSetup, progress: Progress | None = None) -> VirtualRig:
        """Everything below the wire that the protocol asks for, and the drivers above it."""
        rig = VirtualRig(self._config, job, self._draw)
        rig.monitors = self.monitors()
        return rig


class VirtualForce(NetFTSensor):
    """The real client on the simulated box; each press restarts its noise."""

    def __init__(self, box: NetFTBox, clock: VirtualClock, scene: GelScene | None) -> None:
        """scene: told of a new press when no camera does that."""
        super().__init__(LockstepLink(box), clock)
        self._box = box
        self._scene = scene

    def begin(self, stream: str) -> None:
        """Re-seed, then tare as the real client does."""
        self._box.reseed(stream)
        if self._scene is not None:
            self._scene.begin(stream)
        super().begin(stream)


class VirtualRig(Rig):
    """Clock, controller behind its wire, gel, camera and force box of one run."""

    def __init__(self, config: VirtualConfig, job: RigSetup, draw: SensorDraw) -> None:
        """draw: of the true sensor; that of the job is nominal."""
        self._job, self._config, self._draw = job, config, draw
        stage, simulator, clock = config.stage, config.virtual, VirtualClock()
        controller = GrblController.for_stage(stage, clock)
        protocol, skin = draw.protocol(job.protocol), draw.skin(job.sensor.skin)
        self.presses = presses = Presses(protocol, skin, simulator.gel)
        self._crop: LatticeCrop | None = None
        if "image" in job.protocol.channels:
            from .drawing import crop_lattice

            self._crop = crop_lattice(config, job.sensor, presses.axes_mm(), draw)
        self.scene = GelScene(
            controller, clock, stage.frame, presses.increments, presses.open, self._crop,
            presses.modulus_mpa,
        )  # fmt: skip
        host = GrblStage.from_config(stage, clock, SerialLink(controller, clock, baud=stage.baud))
        host.whole_moves = True  # the gel is solved along the lines of the plan
        drift = Drift(config, job, self.scene) if simulator.drift else None
        with ExitStack() as resources:
            resources.callback(host.close)
            camera: VirtualCamera | None = None
            if self._crop is not None:
                from .drawing import VirtualCamera

                picture, lens = self._picture(self._crop)
                camera = VirtualCamera(
                    picture, clock, job.seed, self.scene, self._crop.lattice, lens, job.folder,
                    drift,
                )  # fmt: skip
                resources.callback(camera.close)
            force: VirtualForce | None = None
            if "force" in job.protocol.channels:
                scene = self.scene if self._crop is None else None
                wrenches = (drift or self.scene).wrenches
                box = NetFTBox(config.force, clock, job.seed, wrenches, simulator.force.noise_n)
                force = VirtualForce(box, clock, scene)
                resources.callback(force.close)
            super().__init__(clock, host, camera, force, self.scene.mount)
            self.exit_stack = resources.pop_all()

    def omissions(self) -> Iterator[Note]:
        """Notes on the parts that this scene does not need and did not build."""
        lens = "lens, its maps and rectification"
        if self.camera is None:
            yield Note("camera, picture and printer model", "no channel needs images")
        if self._config.virtual.lens is None:
            yield Note(lens, "this rig uses a pinhole camera")
        elif self.camera is None:
            yield Note(lens, "no channel needs images")
        if self.force is None:
            yield Note("force sensor", "no channel 'force'")
        yield from gel_not_built(self.presses, self._choices)
        yield Note("solid models", "a run needs only the shape parameters")

    def notes(self) -> Iterator[Note]:
        """Notes on lens and gel for readers of the results."""
        job = self._job
        if self._crop is not None and isinstance(job.view, Rectified):
            from .lens import lens_notes

            yield from lens_notes(self._config, job.view, job.recipe.patch_mm)
        if not job.air and self.presses.observed:
            yield from gel_notes(self.presses, self._choices, job.sensor.skin)

    def _picture(self, crop: LatticeCrop) -> tuple[FrameRenderer, Fisheye | Pinhole | None]:
        """Return the renderer of the printed gel and its true camera; None: the recorded one."""
        from deltact_fab.fabricate import PatternRecipe

        from .drawing import picture_geometry
        from .picture import FrameRenderer

        config, job, draw = self._config, self._job, self._draw
        assert isinstance(job.view, Pinhole | Rectified), "of a virtual rig that takes images"
        assert isinstance(job.recipe, PatternRecipe), "whoever asks for images has all of it"
        geometry, lens = picture_geometry(config, job.sensor, job.view, crop.lattice, draw)
        return FrameRenderer.printed(geometry, config.virtual, job.recipe, job.seed, draw), lens

    @cached_property
    def _choices(self) -> list[Choice]:
        """Mesh and friction of every press that is observed, of the nominal gel: for the record."""
        presses, job = self.presses, self._job
        if self._draw.number is not None:
            presses = Presses(job.protocol, job.sensor.skin, self._config.virtual.gel)
        return [presses.choice(path) for path in presses.paths if presses.observed]
