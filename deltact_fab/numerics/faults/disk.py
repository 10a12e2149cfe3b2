"""A disk that fills up: no file may grow any more."""

from __future__ import annotations

import resource
import signal
from pathlib import Path


class Disk:
    """folder: where runs are kept."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def free(self) -> None:
        """There is room again."""
        resource.setrlimit(resource.RLIMIT_FSIZE, self._limits)

    def fill(self) -> None:
        """From now on nothing more can be written."""
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, self._limits[1]))
