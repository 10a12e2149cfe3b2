"""What did the camera see? The tracking error of a recorded run, frame by frame.

    python examples/measure_a_run.py RUN

RUN is a folder with images that `deltact-fab run` or `demo` wrote (demo-out/run).
"""

from __future__ import annotations

import sys
from pathlib import Path

from deltact_fab.analysis.tracking_error import TrackingResult, analyse

METHOD = "dis-fast"


def main(folder: Path) -> TrackingResult:
    """Errors of one method against the pattern's dots and, of a simulated run, against truth."""
    return analyse(folder, methods=(METHOD,))


if __name__ == "__main__":
    found = main(Path(sys.argv[1]))
    print(found.verdict.line)
    errors = found.frames.groupby("indenter")[["mean_at_dots_mm", "mean_off_dots_mm"]]
    print(errors.mean().round(4).to_string())
