"""How much memory this process holds, and the most it held; only the standard library."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path


def reset_peak_mb() -> float:
    """Start the record of the peak anew where the system can, and return the memory held now."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) / 1024
    return peak_resident_mb()


def peak_resident_mb() -> float:
    """Largest resident memory since `reset_peak_mb`; since the start where that cannot be reset."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    import resource

    unit = 1024 * 1024 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
