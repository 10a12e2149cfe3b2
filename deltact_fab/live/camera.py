"""Cameras and files of images as sources, opened as a run opens them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from .. import catalog
from ..rig.camera.files import Images
from ..rig.camera.model import open_camera
from ..rig.interface import CameraFrame, WallClock
from ..rig.tables import CameraConfig
from .source import NOTHING, KnownSensor


class CameraSource:
    """A camera that runs by itself."""

    live = True

    def __init__(self, config: CameraConfig, folder: Path, known: KnownSensor = NOTHING) -> None:
        """Raises InputError for a camera that cannot be opened."""
        self.name = config.name
        self.known = known
        self._camera = open_camera(config, folder, WallClock())

    def frames(self) -> Iterator[CameraFrame]:
        """As Source. Raises SensorError when the camera stalls or is gone."""
        self._camera.begin("live")
        while True:
            yield self._camera.capture()

    at_rest = frames  # a camera does not know what touches the face

    def close(self) -> None:
        """Let go of the camera."""
        self._camera.close()


class FileSource:
    """Images from the disk; every image counts."""

    live = False

    def __init__(self, images: Images, known: KnownSensor = NOTHING) -> None:
        self.name = images.name
        self.known = known
        self._images = images

    def frames(self) -> Iterator[CameraFrame]:
        """As Source; times as the file has them."""
        for k, image in enumerate(self._images.read()):
            yield CameraFrame(image, k / self._images.rate_hz, k)

    at_rest = frames

    def close(self) -> None:
        """Close the file."""
        self._images.close()


def asked(name: str, size_px: tuple[int, int] | None) -> CameraConfig:
    """A camera that a user names by number, device file or address, and what size to ask for."""
    w, h = size_px or (None, None)
    source = int(name) if name.isdecimal() else name
    return catalog.validate(
        CameraConfig, {"source": source, "width_px": w, "height_px": h}, f"camera {name}"
    )
