"""One pair by al-dic: `.venv-peers/bin/python benchmarks/peers/al_dic_flow.py CASE.npz OUT`.

Writes OUT.npz and OUT.json; see README.md for what is in them.
"""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
from al_dic.core.config import dicpara_default
from al_dic.core.data_structures import GridxyROIRange
from al_dic.core.pipeline import run_aldic

SUBSET_PX = 32  # with 20, its search by correlation mistakes one place for another
BORDER_PX = 24


def solve(rest, moved, step_px, reach_px):
    """Nodes (n, 2) px and their flow (n, 2) px; al-dic says of none that it did not converge."""
    h, w = rest.shape
    para = dicpara_default(
        winsize=SUBSET_PX,
        winstepsize=step_px,
        winsize_min=min(8, step_px),
        gridxy_roi_range=GridxyROIRange(
            gridx=(BORDER_PX, w - 1 - BORDER_PX), gridy=(BORDER_PX, h - 1 - BORDER_PX)
        ),
        reference_mode="accumulative",
        size_of_fft_search_region=reach_px,
        # Widened by itself, it finds likenesses far away: the motion is within reach.
        fft_auto_expand_search=False,
        show_plots=False,
    )
    images = [image.astype(np.float64) / 255 for image in (rest, moved)]
    before = time.process_time()
    found = run_aldic(para, images, [np.ones((h, w))] * 2, compute_strain=False)
    cpu_s = time.process_time() - before
    return found.dic_mesh.coordinates_fem, found.result_disp[0].U.reshape(-1, 2), cpu_s


def main(case_file, out):
    with np.load(case_file) as case:
        given = case["rest"], case["moved"], int(case["step_px"]), int(case["reach_px"])
    small = given[0][:160, :160], given[1][:160, :160]
    solve(*small, given[2], 16)  # compiles
    nodes, flow, cpu_s = solve(*given)
    np.savez(f"{out}.npz", nodes_px=nodes, flow_px=flow)
    told = {"version": version("al-dic"), "cpu_s": cpu_s, "subset_px": SUBSET_PX}
    Path(f"{out}.json").write_text(json.dumps(told), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
