"""Holes of a STEP file by draftwright: `.venv-peers/bin/python ... CASE.npz OUT`; see README.md."""

import json
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
from draftwright import inspect_step


def holes(step_bytes):
    """Places (n, 3) mm, axes (n, 3) and diameters (n,) mm of the holes that it locates."""
    with tempfile.NamedTemporaryFile(suffix=".step") as file:
        file.write(step_bytes)
        file.flush()
        found = inspect_step(file.name)["found"]
    records = [f["feature"] for f in found if f["feature_type"] == "HoleRecord"]
    at = np.array([r["location"] for r in records], float).reshape(-1, 3)
    axis = np.array([r["axis"] for r in records], float).reshape(-1, 3)
    return at, axis, np.array([r["diameter"] for r in records], float)


if __name__ == "__main__":
    case, out = np.load(sys.argv[1]), Path(sys.argv[2])
    before = time.process_time()
    at_mm, axis, diameter_mm = holes(case["step"].tobytes())
    told = {"version": version("draftwright"), "cpu_s": time.process_time() - before}
    np.savez(out.with_suffix(".npz"), at_mm=at_mm, axis=axis, diameter_mm=diameter_mm)
    out.with_suffix(".json").write_text(json.dumps(told))
