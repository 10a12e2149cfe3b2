"""The page of `deltact-fab numerics bench --out OUT`: `python -m benchmarks.bench_table OUT`.

Reads OUT/numerics.json and prints Markdown, as it stands in docs/evidence/bench.md.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

COMMAND = "`deltact-fab numerics bench --out OUT`, `python -m benchmarks.bench_table OUT`"


def page(table: dict[str, Any], stability: list[dict[str, Any]]) -> str:
    """table: faults by moments, with columns and rows. stability: the rows of all cells."""
    columns, rows = table["columns"], table["rows"]
    lines = [
        "# What each fault does, at each moment of a run",
        "",
        f"Made by {COMMAND}:",
        "the real host, force client, guard, camera, runner and writer on a simulated controller",
        "in lockstep. How travel is counted: docs/decisions/0036.",
        "",
        table["note"],
        "",
        "| " + " | ".join(columns) + " |",
        "|" + "---|" * len(columns),
        *("| " + " | ".join(str(value) for value in row) + " |" for row in rows),
        "",
    ]
    outcomes = [row["outcome"] for row in stability]
    kills = [row for row in stability if row["case"].startswith("kill -9")]
    whole = sum(row["outcome"] == "right" for row in kills)
    lines += [
        f"{len(outcomes)} cells and kills: {outcomes.count('refused')} end in the error that names "
        f"the fault, {outcomes.count('right')} in success, {outcomes.count('wrong')} are wrong. "
        f"kill -9 at {len(kills)} random times: {whole} runs ended as the undisturbed one.",
        "",
    ]
    return "\n".join(lines)


def main(out: Path) -> None:
    """Print the page of a folder."""
    found = json.loads((out / "numerics.json").read_text())
    table = next(t for t in found["tables"] if t["title"] == "Faults by moments")
    print(page(table, found["stability"]), end="")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
