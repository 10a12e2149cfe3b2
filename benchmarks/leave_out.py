"""What a protocol does not need, in figures: a run as declared beside one with everything on.

`python -m benchmarks.leave_out [NAME...]` takes the first press of each shipped protocol on the rig
`virtual`, as declared and with every channel on, and for a linear gel also at finite strain; each
in a process of its own with an empty store. Simulated. The table is LEAVE_OUT.md.
"""

from __future__ import annotations

import datetime
import json
import os
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.bench.protocols.tables import Specimen
from deltact_fab.bench.record.run import open_run
from deltact_fab.common import toml_text
from deltact_fab.fabricate import load_recipe
from deltact_fab.paths import shipped_folder

TABLE = Path(__file__).with_name("LEAVE_OUT.md")
EVERY_CHANNEL = ("image", "dots", "force", "shear", "traction")
SEED = 3
LIMIT_S = 240.0  # by hand: drags of several mm take longer, whatever is on
RUN = """
import json, resource, sys, time
from pathlib import Path
from deltact_fab.simulate import RunRequest, run_experiment
summary = run_experiment(RunRequest(sys.argv[1], "virtual", Path(sys.argv[2]), seed={seed}))
used = resource.getrusage(resource.RUSAGE_SELF)
print(json.dumps({{"cpu_s": used.ru_utime + used.ru_stime, "peak_mb": used.ru_maxrss / 1024,
                  "left_out": summary["left_out"]}}))
"""


def first_press(text: str) -> dict[str, Any]:
    """Protocol of the first press: one indenter, place and depth."""
    data = tomllib.loads(text)
    for key in ("indenters", "positions_mm", "depths_mm"):
        data[key] = data.get(key, [])[:1]
    return data


def run(data: dict[str, Any], folder: Path, name: str) -> dict[str, Any]:
    """Cost of a run and the parts that it did not build. Raises CalledProcessError."""
    protocol = folder / f"{name}.toml"
    protocol.write_text(toml_text(data))
    words = [sys.executable, "-c", RUN.format(seed=SEED), str(protocol), str(folder / name)]
    environment = {**os.environ, "DELTACT_FAB_CACHE": str(folder / f"{name}-store")}
    environment |= {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        words, capture_output=True, text=True, env=environment, check=True, timeout=LIMIT_S
    )
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def difference(folder: Path, other: Path) -> tuple[float, int, int]:
    """Largest difference of a force sample in N; images that differ, and all."""
    one, two = open_run(folder), open_run(other)
    images, others = (
        r.frames().dropna(subset="file").set_index("frame_id").file.map(r.data) for r in (one, two)
    )
    changed = int((images != others.reindex(images.index)).sum())
    force_n = 0.0
    if "force" in one.meta["protocol"]["channels"]:
        a, b = (r.force()[["fx_n", "fy_n", "fz_n"]].to_numpy() for r in (one, two))
        force_n = float(np.abs(a - b).max()) if a.shape == b.shape else float("nan")
    return force_n, changed, len(images)


def rows() -> Iterator[str]:
    for path in sorted(shipped_folder("protocols").glob("*.toml")):
        if sys.argv[1:] and path.stem not in sys.argv[1:]:
            continue
        data = first_press(path.read_text())
        if "weights" in data:
            continue  # laid by hand on a real rig
        recipe = load_recipe(Specimen(**data.get("specimen", {})).pattern)
        channels = [name for name in EVERY_CHANNEL if name != "dots" or recipe.dots]
        everything = data | {"channels": channels}
        variants = {"as declared": data, "every channel": everything}
        if data.get("specimen", {}).get("gel_model", "linear") == "linear":
            finite = data.get("specimen", {}) | {"gel_model": "hyperelastic"}
            variants["every channel, finite strain"] = everything | {"specimen": finite}
        with tempfile.TemporaryDirectory() as scratch:
            folder, declared = Path(scratch), None
            for label, variant in variants.items():
                name = label.replace(", ", "-").replace(" ", "-")
                try:
                    result = run(variant, folder, name)
                except subprocess.TimeoutExpired:
                    yield f"| {path.stem} | {label} | over {LIMIT_S:g} s |"
                    break
                except subprocess.CalledProcessError as error:
                    yield f"| {path.stem} | {label} | {error.stderr.strip().splitlines()[-1]} |"
                    continue
                cost = f"{result['cpu_s']:.1f} | {result['peak_mb']:.0f}"
                if declared is None:
                    declared = folder / name
                    parts = "; ".join(part.split(":")[0] for part in result["left_out"])
                    yield f"| {path.stem} | {label} | {cost} | | not built: {parts} |"
                    continue
                force_n, changed, n = difference(declared, folder / name)
                yield f"| | {label} | {cost} | {force_n:.3g} | {changed} of {n} images differ |"


def main() -> None:
    lines = ["| protocol | run | CPU s | MB | force differs by, N | |", "|---|---|---|---|---|---|"]
    for row in rows():
        lines.append(row)
        print(row, flush=True)
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    head = [
        "# What a protocol does not need",
        "",
        f"Written by `python -m benchmarks.leave_out` ({today}). First press of each protocol on",
        "the rig `virtual`; a run over the limit of time has no row.",
        "",
    ]
    if not sys.argv[1:]:
        TABLE.write_text("\n".join([*head, *lines, ""]))


if __name__ == "__main__":
    main()
