"""Force against depth: a power law fitted to the presses of a recorded run.

    python examples/force_law.py RUN [INDENTER]

Hertz's exponent for a ball on a half-space is 1.5; a layer on a rigid back has more, a flat tip 1.
Only the record is read, so it also works with a run of a real bench.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import deltact_fab as dt


def main(folder: Path, indenter: str = "sphere:10", least_mm: float = 0.2) -> tuple[float, float]:
    """Exponent and force at 1 mm (N), from the samples of the first press deeper than least_mm."""
    run = dt.load_run(folder)
    steps = run.steps()
    step = steps[(steps["indenter"] == indenter) & (steps["kind"] == "press")].iloc[0]
    pose, force = run.pose(step["press"]), run.force(step["press"])
    depth_mm = -np.interp(force["t_press_s"], pose["t_press_s"], pose["z_mm"])
    pressing = (force["step_id"] == step["step_id"]) & (depth_mm > least_mm)
    normal_n = -force["fz_n"][pressing]
    exponent, log_n = np.polyfit(np.log(depth_mm[pressing]), np.log(normal_n), 1)
    return float(exponent), float(np.exp(log_n))


if __name__ == "__main__":
    exponent, at_1_mm_n = main(Path(sys.argv[1]), *sys.argv[2:])
    print(f"force = {at_1_mm_n:.2f} N x (depth / mm)^{exponent:.2f}")
