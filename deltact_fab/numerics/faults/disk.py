"""A real disk that fills up: a small file system in memory, or a limit of the size of files."""

from __future__ import annotations

import contextlib
import resource
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path


class Disk:
    """folder: where runs are kept. A file in it takes all room, or no file may grow any more."""

    def __init__(self, folder: Path, mounted: bool) -> None:
        self.folder = folder
        self._mounted = mounted
        self._limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def free(self) -> None:
        """There is room again."""
        resource.setrlimit(resource.RLIMIT_FSIZE, self._limits)
        (self.folder / "filler").unlink(missing_ok=True)

    def fill(self) -> None:
        """From now on nothing more can be written."""
        if not self._mounted:
            # What the system says then is another word for the same: the file may not grow.
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (0, self._limits[1]))
            return
        with contextlib.suppress(OSError), (self.folder / "filler").open("wb", 0) as file:
            while True:
                file.write(bytes(1024))


@contextlib.contextmanager
def small_disk(folder: Path, mib: int = 4) -> Iterator[Disk]:
    """folder: a new one; a file system of its own where mounting is permitted."""
    folder.mkdir()
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={mib}m", "tmpfs", str(folder)],
        capture_output=True, check=False,
    )  # fmt: skip
    disk = Disk(folder, done.returncode == 0)
    try:
        yield disk
    finally:
        disk.free()
        if done.returncode == 0:
            subprocess.run(["umount", str(folder)], check=True)
        shutil.rmtree(folder)
