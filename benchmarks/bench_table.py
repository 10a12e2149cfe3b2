"""The page of `rig rehearse PROTOCOL --rig RIG --out OUT`: `python -m benchmarks.bench_table OUT`.

Reads OUT/rehearsal.json and prints Markdown, as it stands in docs/evidence/bench.md.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

COMMAND = (
    "`deltact-fab rig rehearse first-press --rig grbl-bench --out OUT`,\n"
    "`python -m benchmarks.bench_table OUT`"
)


def page(found: dict[str, Any]) -> str:
    """found: as `Rehearsal.as_dict`. Rows: faults that cost 0.005 mm of depth or a row."""
    told = [c for c in found["cells"] if c["deeper_mm"] >= 0.005 or c["wrong"]]
    others = [c for c in found["cells"] if c not in told]
    silent = [c["fault"] for c in others if c["outcome"] == "success"]
    stopped = [c["fault"] for c in others if c["outcome"] != "success"]
    rows = [
        f"| {c['fault']} | {c['moment']} | {c['outcome']} | "
        + ("-" if c["travel_mm"] is None else f"{c['travel_mm']:.2f}")
        + f" | {c['deeper_mm']:.2f} | {c['wrong'] or 'the same record'} |"
        for c in told
    ]
    return "\n".join(
        [
            "# What each fault does",
            "",
            f"{time.strftime('%Y-%m-%d')}.",
            f"Made by {COMMAND}; OUT/rehearsal.json has every fault and its line:",
            "the real host, force client, guard, camera, runner and writer on a simulated board in",
            "lockstep; `--thorough` strikes each fault at each moment. Travel counts from when the",
            "fault had come to the host, or from the stop byte after a time-out.",
            "",
            f"{found['verdict'][0].upper()}{found['verdict'][1:]}; {len(found['cells'])} of "
            f"{found['of']} faults at moments.",
            "",
            "| fault | when | what the operator reads | travel, mm | lower, mm | with --resume |",
            "|---|---|---|---|---|---|",
            *rows,
            "",
            f"Stopped with one line, the tip lower by less than 0.005 mm: {'; '.join(stopped)}.",
            f"Gone on to the end: {'; '.join(silent)}.",
            "",
        ]
    )


if __name__ == "__main__":
    print(page(json.loads((Path(sys.argv[1]) / "rehearsal.json").read_text())), end="")
