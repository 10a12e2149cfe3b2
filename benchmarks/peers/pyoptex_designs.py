"""I-optimal designs by pyoptex: `PYTHON benchmarks/peers/pyoptex_designs.py CASE.npz OUT`.

Writes OUT.npz and OUT.json; see README.md for what is in them.
"""

import json
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
from pyoptex.doe.fixed_structure import (
    Factor,
    create_fixed_structure_design,
    create_parameters,
    default_fn,
)
from pyoptex.doe.fixed_structure.metric import Iopt
from pyoptex.utils.model import model2Y2X, partial_rsm_names


class GridIopt(Iopt):
    """I-optimality averaged over a grid of points, not over drawn ones."""

    def __init__(self, points):
        super().__init__()
        self.points = points

    def preinit(self, params):
        rows = params.fn.Y2X(self.points)
        self.moments = rows.T @ rows / len(rows)


def main(case_file, out):
    with np.load(case_file) as case:
        levels, points, counts = case["levels"], case["points"], case["counts"]
        starts = int(case["starts"])
    factors = [Factor(name, type="continuous", levels=levels.tolist()) for name in "xy"]
    model = partial_rsm_names(dict.fromkeys("xy", "quad"))
    np.random.seed(0)  # noqa: NPY002 - what pyoptex draws from
    designs = {}
    for count in counts.tolist():
        function = default_fn(factors, GridIopt(points), model2Y2X(model, factors))
        parameters = create_parameters(factors, function, count)
        design, _ = create_fixed_structure_design(parameters, n_tries=starts)
        designs[f"design_{count}"] = pd.DataFrame(design)[["x", "y"]].to_numpy(float)
    np.savez(f"{out}.npz", **designs)
    Path(f"{out}.json").write_text(json.dumps({"version": version("pyoptex")}), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
