"""A session that is killed: `python -m deltact_fab.numerics.faults.killed RUN`, a process.

It says when it begins and when it is done, so that whoever kills it knows when it lives.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

from .bench import FaultBench


def kill_after(folder: Path, seconds: float) -> float | None:
    """Go on with the run of a folder and SIGKILL that after so long; None.

    Ended before, the seconds that it took, from its first word on.
    """
    with subprocess.Popen(
        [sys.executable, "-m", __name__, str(folder)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        began_s = time.monotonic()
        try:
            process.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            return None
        return time.monotonic() - began_s


if __name__ == "__main__":
    bench = FaultBench()
    print("begins", flush=True)
    bench.run(Path(sys.argv[1]))
