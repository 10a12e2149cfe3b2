"""Images from the disk: a folder of them, a video, a recorded run. Every image counts."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from .. import catalog, record
from ..errors import InputError, RunFailed
from ..rig.interface import Frame
from ..shapes.sensor import SkinDimensions
from .device import quietly_opened
from .source import NOTHING, Known

IMAGE_NAMES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
ASSUMED_HZ = 30.0
"""Of images that come without times."""


class Folder:
    """The images of a folder in order of their names, numbers by size."""

    live = False
    known = NOTHING

    def __init__(self, folder: Path) -> None:
        """Raises InputError for a folder without images."""
        self.name = str(folder)
        self._files = sorted(
            (p for p in folder.iterdir() if p.suffix.lower() in IMAGE_NAMES), key=_natural
        )
        if not self._files:
            raise InputError(f"{folder}: no image in this folder ({', '.join(IMAGE_NAMES)})")

    def frames(self) -> Iterator[Frame]:
        """As Source; times as if ASSUMED_HZ a second had been taken."""
        for k, file in enumerate(self._files):
            try:
                data = np.frombuffer(file.read_bytes(), np.uint8)
            except OSError as why:
                raise RunFailed(f"{file}: cannot be read: {why.strerror}") from why
            image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
            if image is None:
                raise RunFailed(f"{file}: does not decode as an image")
            yield Frame(np.asarray(image, np.uint8), k / ASSUMED_HZ)

    def close(self) -> None:
        """Nothing is held open."""


def _natural(path: Path) -> list[tuple[int, str]]:
    return [(int(p), "") if p.isdigit() else (-1, p) for p in re.split(r"(\d+)", path.name)]


class Video:
    """A video file."""

    live = False
    known = NOTHING

    def __init__(self, file: Path) -> None:
        """Raises InputError for a file that is no video."""
        self.name = str(file)
        self._capture = quietly_opened(str(file))
        if not self._capture.isOpened():
            raise InputError(f"{file}: is no video that can be read")

    def frames(self) -> Iterator[Frame]:
        """As Source; times as the file has them."""
        hz = self._capture.get(cv2.CAP_PROP_FPS) or ASSUMED_HZ
        k = 0
        while True:
            done, image = self._capture.read()
            if not done:
                break
            yield Frame(np.asarray(image, np.uint8), k / hz)
            k += 1
        if k == 0:
            raise RunFailed(f"{self.name}: holds no image")

    def close(self) -> None:
        """Close the file."""
        self._capture.release()


class RecordedRun:
    """A run's images as the camera gave them, in order of capture."""

    live = False

    def __init__(self, folder: Path) -> None:
        """Raises InputError for a folder that is no run, or one without images."""
        self.name = str(folder)
        self._run = run = record.open(folder)
        specimen = run.meta["protocol"]["specimen"]
        skin = run.meta["sensor"]["skin"]
        self.known = Known(
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

    def frames(self) -> Iterator[Frame]:
        """As Source; times of the rig's clock."""
        for file, t_s in zip(self._frames["file"], self._frames["t_s"], strict=True):
            yield Frame(self._run.raw(str(file)), float(t_s))

    def close(self) -> None:
        """Nothing is held open."""
