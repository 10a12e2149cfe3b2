"""Trials of `analyze compare`: sensors of one kind against each other, and a planted difference.

A pool of sensors drawn from one population is run once (2 CPU hours less what DIR already has):

    python -m benchmarks.compare_trials --pool DIR

writes their figures to `compare_pool.json`. Without --pool the trials are drawn from that file:
whole units, without replacement, some to side a and some to side b.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from deltact_fab.common import read_json, whole_file
from deltact_fab.estimate.analysis.difference import chance_of_difference
from deltact_fab.estimate.analysis.press_figures import (
    COMPARED_MEASURES,
    press_figures,
    stored_figures,
)
from deltact_fab.simulate import RunRequest, run_experiment
from deltact_fab.studies.trial.figures import compare_drawn

POOL_FILE = Path(__file__).with_name("compare_pool.json")
SENSORS, TRIALS, UNITS = 60, 200, 5
POOL_MEASURES = ("tracking", "depth", "noise", "force")  # time is the machine's, not the sensor's
PLANTED_SPREADS = 2.0  # difference, in standard deviations between sensors
PROTOCOL = """
name = "compared"
channels = ["image", "force", "shear"]
order = "random"
press = [
    {indenter = "sphere:10", depth_mm = 1.0, shear_x_mm = 0.4},
    {indenter = "sphere:10", x_mm = 5.0, y_mm = 4.0, depth_mm = 0.8, shear_y_mm = 0.4},
    {indenter = "sphere:10", x_mm = -5.0, y_mm = 3.0, depth_mm = 1.0, shear_x_mm = -0.4},
    {indenter = "sphere:10", x_mm = -3.0, y_mm = -4.0, depth_mm = 0.6, shear_y_mm = 0.3},
    {indenter = "sphere:10", x_mm = 4.0, y_mm = -3.0, depth_mm = 1.2, shear_y_mm = -0.5},
]
[reference]
every = 3
depth_mm = 1.0
[capture]
settle_s = 1.0
[specimen]
pattern = "recommended"
"""
SENSORS_RIG = Path("protocols/rigs/virtual-sensors.toml")


def run_sensors(folder: Path, protocol: str, rig: Path, count: int) -> Iterator[tuple[int, Path]]:
    """Run a protocol on each sensor of a rig that is not in the folder yet; yield their folders."""
    folder.mkdir(exist_ok=True)
    file = folder / "protocol.toml"
    file.write_text(protocol)
    for number in range(1, count + 1):
        out = folder / f"sensor-{number}"
        if not (out / "summary.json").exists():
            run_experiment(RunRequest(str(file), str(rig), out, number, sensor=number), resume=True)
        yield number, out


def measure_pool(folder: Path, rig: Path) -> dict[str, list[float]]:
    """Run each sensor of the pool that is not in the folder yet; figures by measure."""
    figures: dict[str, list[float]] = {name: [] for name in POOL_MEASURES}
    for number, out in run_sensors(folder, PROTOCOL, rig, SENSORS):
        for name, values in figures.items():
            presses = stored_figures(out, name, "fused") or press_figures(out, name, "fused")
            values.append(COMPARED_MEASURES[name].over_presses(presses.values()))
        print(number, {name: values[-1] for name, values in figures.items()}, flush=True)
    return figures


def planted(pool: np.ndarray) -> tuple[float, float]:
    """Factor that is planted in a pool, and the chance that it is found."""
    spread = float(np.std(np.log(pool), ddof=1))
    effect = PLANTED_SPREADS * spread
    return math.exp(effect), chance_of_difference(effect, spread, UNITS, paired=False)


def main() -> None:
    """Print the trials of each measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pool", type=Path, metavar="DIR")
    parser.add_argument("--rig", type=Path, default=SENSORS_RIG)
    args = parser.parse_args()
    if args.pool:
        text = json.dumps(measure_pool(args.pool, args.rig), indent=1) + "\n"
        with whole_file(POOL_FILE) as file:
            file.write_text(text)
    print(f"{TRIALS} trials of {UNITS} against {UNITS} out of {SENSORS} drawn sensors, simulated\n")
    print("| measure | spread between sensors, % | same differ | planted, % | told | found |")
    print("|---|---|---|---|---|---|")
    for name, values in read_json(POOL_FILE).items():
        pool = np.array(values)
        factor, chance = planted(pool)
        spread = 100 * float(np.std(np.log(pool), ddof=1))
        same = compare_drawn(pool, UNITS, 1.0, TRIALS, True, 61)[1]
        found = compare_drawn(pool, UNITS, factor, TRIALS, True, 62)[0]
        print(f"| {name} | {spread:.1f} | {same} | {100 * (factor - 1):.0f} | {chance:.2f} "
              f"| {found / TRIALS:.2f} |")  # fmt: skip


if __name__ == "__main__":
    main()
