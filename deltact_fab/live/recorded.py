"""A recorded run as a source: its images from the disk, every one of them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from .. import catalog, record
from ..errors import InputError
from ..rig.interface import CameraFrame
from ..shapes.sensor import SkinDimensions
from .source import KnownSensor


class RecordedRun:
    """A run's images as the camera gave them, in order of capture."""

    live = False

    def __init__(self, folder: Path) -> None:
        """Raises InputError for a folder that is no run, or one without images."""
        self.name = str(folder)
        self._run = run = record.open(folder)
        specimen = run.meta["protocol"]["specimen"]
        skin = run.meta["sensor"]["skin"]
        self.known = KnownSensor(
            run.camera,
            run.flat,
            catalog.validate(SkinDimensions, skin, f"{folder}/run.json: sensor.skin"),
            recipe=run.pattern["recipe"],
            design=specimen["design"],
            serial=specimen.get("serial"),
            simulated=f"simulated, seed {run.meta['seed']}" if run.simulated else None,
        )
        self._frames = run.frames().dropna(subset=["file"])
        if self._frames.empty:
            raise InputError(f"{folder}: a run without images")

    def frames(self) -> Iterator[CameraFrame]:
        """As Source; times of the rig's clock."""
        for file, t_s in zip(self._frames["file"], self._frames["t_s"], strict=True):
            yield CameraFrame(self._run.raw(str(file)), float(t_s))

    def close(self) -> None:
        """Nothing is held open."""
