"""Photographs by a real rig's camera, to calibrate it: boards on the face, a blank skin."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from ...errors import InputError
from ...files import making, write_whole
from ...record import encode_png
from ..interface import WallClock
from .config import CameraConfig
from .open import open_camera


def photograph(
    config: CameraConfig,
    folder: Path,
    out: Path,
    count: int,
    before: Callable[[int], None] = lambda number: None,
) -> list[Path]:
    """Write out/contact/1.png and on, raw as the camera gives them, and return the files.

    folder: of the rig file. before: called with the number of an image; it is exposed afterwards.
    Raises InputError for an `out` that is there already or a camera that cannot be opened, and
    SensorError when that gives no images.
    """
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise InputError(f"{out}: is there already; name a new folder")
    files = []
    with closing(open_camera(config, folder, WallClock())) as camera:
        camera.capture()  # it runs, and has the settings of the rig file
        with making(out):
            (out / "contact").mkdir(parents=True, exist_ok=True)
        for number in range(1, count + 1):
            before(number)
            camera.begin("photograph")
            file = out / "contact" / f"{number}.png"
            write_whole(file, encode_png(camera.capture().image))
            files.append(file)
    return files
