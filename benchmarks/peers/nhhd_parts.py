"""Parts of fields by nHHD: `.venv-peers/bin/python benchmarks/peers/nhhd_parts.py CASE.npz OUT`.

Writes OUT.npz and OUT.json; see README.md for what is in them.
"""

import json
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np

np.float = float  # noqa: NPY001 - pynhhd 1.1.0 asks for it, numpy has not had it since 1.24
from pynhhd import nHHD  # noqa: E402


def main(case_file, out):
    with np.load(case_file) as case:
        fields = case["fields"]
    parts = []
    for field in fields:
        solver = nHHD(grid=field.shape[:2], spacings=(1.0, 1.0))
        solver.decompose(field, num_cores=1)
        parts.append((solver.d, solver.r, solver.h))
    d, r, h = (np.stack(part) for part in zip(*parts, strict=True))
    np.savez(f"{out}.npz", d=d, r=r, h=h)
    Path(f"{out}.json").write_text(json.dumps({"version": version("pynhhd")}), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
