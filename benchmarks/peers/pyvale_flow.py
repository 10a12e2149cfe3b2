"""One pair by pyvale: `.venv-peers/bin/python benchmarks/peers/pyvale_flow.py CASE.npz OUT`.

Writes OUT.npz and OUT.json; see README.md for what is in them.
"""

import json
import os
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
from pyvale import dic

SUBSET_PX = 15
BORDER_PX = 16


def solve(rest, moved, step_px, reach_px, threads):
    """Nodes (n, 2) px and their flow (n, 2) px; nan where pyvale says that it did not converge."""
    inside = np.zeros(rest.shape, bool)
    inside[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX] = True
    with tempfile.TemporaryDirectory() as folder:
        before = time.process_time()
        # The images come as they are to be matched, so pyvale's own blur is left out.
        dic.calculate_2d(
            reference=rest, deformed=moved[None], roi_mask=inside, seed=[64, 64],
            subset_size=SUBSET_PX, subset_step=step_px, max_displacement=reach_px,
            num_threads=threads, image_filter_kernel=1, output_basepath=folder,
            output_below_threshold=True, print_level=0,
        )  # fmt: skip
        cpu_s = time.process_time() - before
        (table,) = Path(folder).glob("*.csv")
        # subset_x, subset_y, disp_u, disp_v, converged
        rows = np.loadtxt(table, delimiter=",", skiprows=1, usecols=(0, 1, 2, 3, 5))
    flow = rows[:, 2:4]
    flow[rows[:, 4] == 0] = np.nan
    return rows[:, :2], flow, cpu_s


def main(case_file, out):
    with np.load(case_file) as case:
        nodes, flow, cpu_s = solve(
            case["rest"], case["moved"], int(case["step_px"]), int(case["reach_px"]),
            int(os.environ.get("OMP_NUM_THREADS", "1")),
        )  # fmt: skip
    np.savez(f"{out}.npz", nodes_px=nodes, flow_px=flow)
    told = {"version": version("pyvale"), "cpu_s": cpu_s, "subset_px": SUBSET_PX}
    Path(f"{out}.json").write_text(json.dumps(told), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
