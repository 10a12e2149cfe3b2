"""A simulated camera's process: the images of a folder over and over, stamped, on standard output.

As `[camera] command` with `stamped` of a rig file: python -m deltact_fab.simulate.virtual.shown
FOLDER HZ
"""

from __future__ import annotations

import itertools
import struct
import sys
import time
from pathlib import Path

import cv2


def main(folder: str, rate_hz: str) -> None:
    """Until whoever reads is gone."""
    images = [cv2.imread(str(file)) for file in sorted(Path(folder).iterdir())]
    start_ns = time.monotonic_ns()
    for number in itertools.count():
        stamp = struct.pack("<qII", time.monotonic_ns(), number % 2**32, 0)
        image = images[number % len(images)]
        assert image is not None
        sys.stdout.buffer.write(stamp + image.tobytes())
        sys.stdout.buffer.flush()
        due_ns = start_ns + round((number + 1) / float(rate_hz) * 1e9)
        time.sleep(max(due_ns - time.monotonic_ns(), 0) / 1e9)


if __name__ == "__main__":
    main(*sys.argv[1:])
