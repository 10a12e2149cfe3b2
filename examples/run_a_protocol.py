"""Run a protocol on the virtual bench, and compare the measured force with Hertz.

    python examples/run_a_protocol.py OUT

Everything below the drivers is simulated; `rig="bench.toml"` instead of "virtual" drives your own.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import deltact_fab as dt

PROTOCOL = """
name = "two-depths"
indenters = ["sphere:10"]
positions_mm = [[0.0, 0.0]]
depths_mm = [0.3, 0.6]
channels = ["force"]
[capture]
settle_s = 1.0
"""


def main(out: Path, rig: str = "virtual") -> dict[float, tuple[float, float]]:
    """Normal force in newtons by depth (mm): measured at rest, and Hertz's for a half-space."""
    out.mkdir(parents=True)
    protocol = out / "two-depths.toml"
    protocol.write_text(PROTOCOL)
    dt.run_protocol(dt.RunRequest(str(protocol), rig, out / "run", seed=1))
    frames = dt.load_run(out / "run").frames()
    found = {}
    for row in frames[frames["settled"] & (frames["z_mm"] < 0)].itertuples():
        depth_mm = -float(row.z_mm)
        hertz_n = 4 / 3 * 0.56 / (1 - 0.49**2) * math.sqrt(5.0) * depth_mm**1.5
        found[round(depth_mm, 2)] = (-float(row.fz_n), hertz_n)
    return found


if __name__ == "__main__":
    for depth_mm, (measured_n, hertz_n) in main(Path(sys.argv[1])).items():
        print(f"{depth_mm:g} mm: {measured_n:.3f} N, on a half-space {hertz_n:.3f} N")
