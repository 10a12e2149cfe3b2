"""The simulated side of a virtual bench; only what the protocol's channels need is built."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from ..optics import Fisheye, Pinhole, Rectified
from ..rig.config import VirtualConfig
from ..rig.job import RigSetup
from .clock import VirtualClock
from .firmware import board_of
from .gel_summary import gel_left_out, gel_notes
from .netft import NetFTBox
from .presses import Presses
from .scene import GelScene, LatticeCrop

if TYPE_CHECKING:
    from ..gel.level import Choice
    from .picture import FrameRenderer


class Below:
    """Controller, gel, picture and force box of one run, on one clock that is advanced.

    crop: what the camera can see of the face; None when nothing is drawn.
    """

    def __init__(
        self,
        config: VirtualConfig,
        job: RigSetup,
        clock: VirtualClock,
    ) -> None:
        self._config, self._job = config, job
        self.clock = clock
        stage, simulator = config.stage, config.virtual
        self.controller = board_of(stage, clock)
        self.presses = Presses(job.protocol, job.sensor.skin, simulator.gel)
        self.crop = self._crop() if "image" in job.protocol.channels else None
        self.scene = GelScene(
            self.controller,
            clock,
            stage.frame,
            self.presses.increments,
            self.presses.open,
            self.crop,
            self.presses.modulus_mpa,
        )

    def box(self) -> NetFTBox:
        """The force box on this gel."""
        noise_n = self._config.virtual.force.noise_n
        return NetFTBox(
            self._config.force, self.clock, self._job.seed, self.scene.wrenches, noise_n
        )

    def picture(self) -> tuple[FrameRenderer, Fisheye | None]:
        """What draws the printed gel, and the true lens it is drawn through; None: a pinhole."""
        from .drawing import geometry_of, printed

        assert self.crop is not None, "images are asked for"
        config, job = self._config, self._job
        assert isinstance(job.view, Pinhole | Rectified), "of a virtual rig that takes images"
        geometry, lens = geometry_of(config, job.sensor, job.view, self.crop.lattice)
        return printed(config, job.recipe, geometry, job.seed), lens

    def left_out(self) -> list[str]:
        """What this scene's gel did not solve or keep, and why."""
        return gel_left_out(self.presses, self._choices)

    def notes(self) -> list[str]:
        """What a reader of the results must know of lens and gel."""
        job, lines = self._job, []
        if self.crop is not None and isinstance(job.view, Rectified):
            from .lens import lens_notes

            lines += lens_notes(self._config, job.view, job.recipe.patch_mm)
        if not job.air and self.presses.observed:
            lines += gel_notes(self.presses, self._choices, job.sensor.skin)
        return lines

    @cached_property
    def _choices(self) -> list[Choice]:
        """Mesh and friction of every press that is observed."""
        paths = self.presses.paths if self.presses.observed else ()
        return [self.presses.choice(path) for path in paths]

    def _crop(self) -> LatticeCrop:
        from .drawing import crop_of

        return crop_of(self._config, self._job.sensor, self.presses.axes_mm())
