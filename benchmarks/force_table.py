"""The table of force models: `python -m benchmarks.force_table [--only NAME]`.

Solves its presses the first time (an hour of one core; kept in the cache), then a minute a row.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from .force import CONDITIONS, force_row, learning_row
from .force_rivals import rival_row

FIELDS = {
    "pressure_of_peak": "pressure, of its peak", "shear_of_peak": "shear, of that peak",
    "total": "total, of the force", "not_found": "not found", "place_mm": "place, mm",
    "place_most_mm": "at most", "depth_mm": "depth over the contact, mm",
    "face_mm": "over the face", "deepest_depth_mm": "the deepest: over the contact",
    "deepest_face_mm": "over the face", "cpu_ms": "CPU, ms",
}  # fmt: skip
HEAD = ("condition", "model: left out", "normal, N", "shear x", "shear y", "torque, N mm", "twist")


def rows() -> Iterator[tuple[str, Callable[[], dict[str, Any]]]]:
    """Name and call of each."""
    for believed in CONDITIONS:
        yield believed.name, partial(force_row, believed)
    yield "learning curve", learning_row
    for kind in ("ridge", "kernel"):
        yield f"{kind} on the flow", partial(rival_row, kind)


def lines(name: str, result: dict[str, Any]) -> Iterator[str]:
    """Of one row, a line a model and what was left out."""
    for model, found in result.items():
        if isinstance(found, list) and model != "range":
            yield _line((name, model, *_cells(found), *[None] * len(FIELDS)))
        elif isinstance(found, dict):
            for group in ("place", "indenter", "other"):
                more = [found.get(k) if group == "place" else None for k in FIELDS]
                yield _line((name, f"{model}: {group}", *_cells(found[group]), *more))


def _cells(rms: Sequence[float]) -> tuple[float, ...]:
    return rms[2], rms[0], rms[1], math.hypot(rms[3], rms[4]), rms[5]


def _line(cells: Sequence[Any]) -> str:
    told = ("" if c is None else c if isinstance(c, str) else f"{c:.3g}" for c in cells)
    return f"| {' | '.join(told)} |"


def main() -> None:
    """Print the rows as they are done, as markdown; simulated."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="rows whose name starts so")
    only = parser.parse_args().only
    head = (*HEAD, *FIELDS.values())
    print(_line(head), "|" + "---|" * len(head), sep="\n")
    for name, call in rows():
        if name.startswith(only):
            print(*lines(name, call()), sep="\n", flush=True)


if __name__ == "__main__":
    main()
