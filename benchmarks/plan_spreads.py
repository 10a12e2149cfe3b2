"""Spreads of the figures of presses, which a plan without a pilot assumes (`studies/plan/mean.py`).

Four sensors drawn from a population, the same presses on each: six places at four depths up to
6 N, three tips, each press twice; frames at rest. Simulated with a linear gel.

    python -m benchmarks.plan_spreads --runs DIR

runs them (half a CPU hour less what DIR already has) and writes their figures to
`plan_spreads.json`. Without --runs the table is printed from that file, and the spread between
sensors from the sixty of `compare_pool.json`, less that of their five presses.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pandas as pd

from deltact_fab.bench import open_run
from deltact_fab.common import read_json, whole_file
from deltact_fab.estimate.analysis.press_figures import press_figures
from deltact_fab.sensor import GelMaterial, SkinDimensions
from deltact_fab.simulate import RunRequest
from deltact_fab.studies.plan.candidates import DEPTH_LEVELS, GelFeatures, spread_candidates

from .compare_trials import POOL_FILE, POOL_MEASURES, SENSORS_RIG, run_sensors

SPREADS_FILE = Path(__file__).with_name("plan_spreads.json")
TIPS, PLACES, SENSORS, RANGE_N = ("sphere:10", "sphere:15", "sphere:22"), 6, 4, 6.0
POOL_PRESSES = 5


def protocol_text(rig: Path) -> str:
    """Protocol of the presses, in quadrants as they come."""
    gel = GelFeatures(SkinDimensions(), GelMaterial(0.56, 0.49, 0.5), 1.0)
    view = RunRequest("smoke", str(rig)).view
    assert view is not None
    candidates, _ = spread_candidates(gel, TIPS, RANGE_N, view, 0)
    lines, levels = "", len(DEPTH_LEVELS)
    for tip in TIPS:
        by_tip = [press for press in candidates if press.indenter == tip]
        for k in range(PLACES):
            press = by_tip[levels * k + k % levels].mirrored((0, 1, 3, 2, 1, 0)[k])
            row = press.as_dict() | {"repeats": 2}
            lines += f"    {{{', '.join(f'{key} = {json.dumps(v)}' for key, v in row.items())}}},\n"
    return (
        'name = "spread"\nchannels = ["image", "force", "shear"]\norder = "random"\n'
        f"press = [\n{lines}]\n[capture]\nsettle_s = 1.0\n[specimen]\n"
        'pattern = "recommended"\n'
    )


def measure_sensors(folder: Path, rig: Path) -> list[dict[str, object]]:
    """Figures of each press on each sensor."""
    rows: list[dict[str, object]] = []
    for number, out in run_sensors(folder, protocol_text(rig), rig, SENSORS):
        entries = {entry["name"]: entry for entry in open_run(out).meta["presses"]}
        for measure in POOL_MEASURES:
            for name, figure in press_figures(out, measure, "fused").items():
                at = f"{entries[name]['x_mm']:g} {entries[name]['y_mm']:g}"
                tip = entries[name]["indenter"]
                rows.append({"measure": measure, "sensor": number, "tip": tip, "place": at,
                             "figure": float(f"{figure:.6g}")})  # fmt: skip
    return rows


def spreads(table: pd.DataFrame, pool: list[float]) -> dict[str, float]:
    """Components of one measure, of logarithms: variances by two-way layouts without repeats."""
    logs = np.log(table["figure"])
    cells = logs.groupby([table["sensor"], table["tip"], table["place"]]).mean()
    tips, places, mixed = [], [], []
    for _, cell in cells.groupby("sensor"):
        square = cell.unstack("tip").to_numpy()
        by_place = square.mean(axis=1)
        rest = square - square.mean(axis=0) - by_place[:, None] + square.mean()
        n, m = square.shape
        mixed.append((rest**2).sum() / ((n - 1) * (m - 1)))
        places.append(by_place.var(ddof=1) - mixed[-1] / m)
        tips.append(square.mean(axis=0).var(ddof=1))
    square = cells.unstack("sensor").to_numpy()
    rest = square - square.mean(axis=0) - square.mean(axis=1)[:, None] + square.mean()
    press = (rest**2).sum() / ((square.shape[0] - 1) * (square.shape[1] - 1))
    squares = {
        "repeat": np.mean(mixed), "place": np.mean(places), "tip": np.mean(tips), "press": press,
        "sensor": np.var(np.log(pool), ddof=1) - press / POOL_PRESSES,
    }  # fmt: skip
    return {"figure": float(table["figure"].mean())} | {
        name: float(np.sqrt(max(square, 0.0))) for name, square in squares.items()
    }


def main() -> None:
    """Print the spreads of each measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=Path, metavar="DIR")
    parser.add_argument("--rig", type=Path, default=SENSORS_RIG)
    args = parser.parse_args()
    if args.runs:
        table = pd.DataFrame(measure_sensors(args.runs, args.rig))
        lines = [f'"{name}": {json.dumps(column.tolist())}' for name, column in table.items()]
        with whole_file(SPREADS_FILE) as file:
            file.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    table, pool = pd.DataFrame(read_json(SPREADS_FILE)), read_json(POOL_FILE)
    for name, part in table.groupby("measure"):
        values = spreads(part, pool[str(name)])
        print(name, {key: float(f"{value:.2g}") for key, value in values.items()})


if __name__ == "__main__":
    main()
