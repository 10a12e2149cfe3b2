"""A folder that another process writes images into while they are measured."""

from __future__ import annotations

import time
from collections.abc import Generator
from pathlib import Path

from ..aliases import Image
from ..errors import RunFailed
from ..rig.camera.files import IMAGE_NAMES, Folder, by_number, decoded

POLL_S = 0.05
STEADY_S = 0.5  # so long a TIFF must not grow: nothing in it says where it ends


class FollowedFolder(Folder):
    """Every image of a folder once it is whole, those that wait in the order of their numbers.

    One that is not whole is waited for, and so are those that follow it. It ends when no byte came
    for silence_s.
    """

    def __init__(self, folder: Path, silence_s: float) -> None:
        self.name = str(folder)
        self._folder, self._silence_s = folder, silence_s

    def read(self) -> Generator[Image, None, None]:
        """As Folder. Raises RunFailed, also for an image that never becomes whole."""
        taken, size, heard_s = set[str](), 0, time.monotonic()
        while True:
            waits = None
            for file in self._new(taken):
                try:
                    data = file.read_bytes()
                except FileNotFoundError:  # it has another name now: this was not its own
                    continue
                if len(data) != size:
                    size, heard_s = len(data), time.monotonic()
                if not _whole(file, data, time.monotonic() - heard_s):
                    waits = file
                    break
                taken.add(file.name)
                yield decoded(file, data)
                size, heard_s = 0, time.monotonic()
            if time.monotonic() - heard_s > self._silence_s:
                if waits is None:
                    return
                raise RunFailed(
                    f"{waits}: not a whole image, and nothing came for {self._silence_s:g} s"
                )
            time.sleep(POLL_S)

    def _new(self, taken: set[str]) -> list[Path]:
        try:
            there = [p for p in self._folder.iterdir() if p.name not in taken]
        except OSError as why:
            raise RunFailed(f"{self.name}: cannot be read: {why.strerror}") from why
        images = (p for p in there if p.suffix.lower() in IMAGE_NAMES and p.name[0] != ".")
        return sorted(images, key=by_number)


def _whole(file: Path, data: bytes, steady_s: float) -> bool:
    """Whether a file is written to its end, which its format tells. steady_s: it did not grow."""
    kind = file.suffix.lower()
    if kind == ".png":
        return data.endswith(b"IEND\xaeB`\x82")
    if kind in (".jpg", ".jpeg"):
        return data.rstrip(b"\0").endswith(b"\xff\xd9")
    if kind == ".bmp":
        return len(data) > 6 and 0 < int.from_bytes(data[2:6], "little") <= len(data)
    return len(data) > 0 and steady_s > STEADY_S
