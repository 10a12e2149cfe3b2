"""Holes that draftwright locates on our STEP files, and whether our drawings place each of them.

`python -m benchmarks.drawing_peers [DESIGN]`. draftwright is AGPL: it reads the files in a process
and an environment of its own, which benchmarks/peers/README.md sets up.
"""

from __future__ import annotations

import sys

import numpy as np

from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.drafting.scheme import scheme
from deltact_fab.fabricate.cad.export import step
from deltact_fab.fabricate.cad.features import features_of
from deltact_fab.fabricate.cad.registry import list_parts

from . import peer

NEAR_MM = 1e-3


def main(design: str = "deltact") -> int:
    """A line a part; 1 when a hole is missing from ours."""
    dims, lacking = load_design(design), 0
    for part in list_parts():
        if part.callouts is None:
            continue
        solid, _ = build_part(part, dims)
        data = np.frombuffer(step.part_bytes(solid, part.name), np.uint8)
        answer = peer.ask("draftwright", "draftwright_holes.py", {"step": data})
        if answer is None:
            print("not run: DELTACT_PEERS names no interpreter with draftwright")
            return 0
        plan = scheme(features_of(solid), part.callouts(part.source(dims)))
        ours = [r for group in plan.rounds for r in group.members if r.hole]
        missing = []
        for at, axis, wide in zip(
            answer["at_mm"], answer["axis"], answer["diameter_mm"], strict=True
        ):
            # Placed where one of our labelled rounds has that axis and that diameter.
            k = int(np.argmax(np.abs(axis)))
            off = [
                np.delete(np.array(r.low_mm) - at, k) for r in ours
                if r.axis == k and abs(2 * r.radius_mm - wide) < NEAR_MM
            ]  # fmt: skip
            if not any(np.hypot(*o) < NEAR_MM for o in off):
                missing.append(f"Ø{wide:g} at {at.round(3).tolist()}")
        lacking += len(missing) + len(plan.faults)
        told = "; ".join([*missing, *plan.faults]) or "all of them placed"
        print(f"{part.name}: {len(answer['at_mm'])} holes by draftwright, {len(ours)} ours: {told}")
    return int(lacking > 0)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
