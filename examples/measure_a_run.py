"""Tracking error of a recorded run, frame by frame.

    python examples/measure_a_run.py RUN

RUN is a folder with images that `deltact-fab run` or `demo` wrote (demo-out/run).
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

import deltact_fab as dt

METHOD = "dis-fast"


def main(folder: Path) -> pd.DataFrame:
    """One row per frame: errors at the pattern's dots and, for a simulated run, against truth."""
    result = dt.analyze_tracking(folder, methods=(METHOD,))
    print(result.verdict.line)
    return result.frames


if __name__ == "__main__":
    errors = main(Path(sys.argv[1])).groupby("indenter")[["mean_at_dots_mm", "mean_off_dots_mm"]]
    print(errors.mean().round(4).to_string())
