"""The simulated gel at rest: forces along a press whose stops rest, and along one whose do not.

What is computed here is kept under the hash of this module: no words or figures belong into it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..protocols.plan import Protocol, expand
from ..rig.simulator import GelConfig
from ..shapes import SkinDimensions
from ..virtual.paths import poses
from ..virtual.presses import Presses


def follow(given: dict[str, Any]) -> dict[str, Any]:
    """One press of a protocol knot by knot.

    given: protocol, gel (resolution) and skin as data, press. Result: t_s (n + 1,) since first
    touch, force_n (n + 1, 3), moved_mm (n + 1,) in plane and at most since the tip last came to
    rest (0 without fields); stops: of each line of motion that ends in contact id, kind, depth_mm,
    rests_s and the knots `arrived` and `left` at the ends of its rest; of the solver flags, dofs
    and seconds.
    """
    protocol = Protocol.model_validate(given["protocol"])
    skin = SkinDimensions(**given["skin"])
    presses = Presses(protocol, skin, GelConfig.model_validate(given["gel"]))
    path = next(path for path in presses.paths if path.press == given["press"])
    solver = presses.of(path).solver
    knots = solver.solve_all()
    planned = poses(path, presses.increments, presses.relaxing_s)
    forces = np.array([(0.0, 0.0, 0.0), *(knot.force_n for knot in knots)]) * presses.modulus_mpa
    moved = np.zeros(len(forces))
    stops = [
        {"id": step.id, "kind": step.kind, "depth_mm": -step.target_mm[2], "rests_s": line.dwell_s}
        for step, line in zip(_in_contact(protocol, path.press), path.lines, strict=True)
    ]
    line = 0
    for n, pose in enumerate(planned, start=1):
        if pose.part == 1.0:
            stops[line] |= {"arrived": n, "left": n}
            line += 1
        elif pose.part == 0.0:
            stops[line - 1]["left"] = n
            moved[n] = _moved(knots[stops[line - 1]["arrived"] - 1], knots[n - 1])
    return {
        "t_s": np.concatenate([[0.0], np.cumsum([pose.seconds for pose in planned])]),
        "force_n": forces,
        "moved_mm": moved,
        "stops": stops,
        "flags": solver.flags,
        "dofs": solver.dofs,
        "seconds": solver.seconds,
    }


def _in_contact(protocol: Protocol, press: str) -> list[Any]:
    """The steps of a press that end in contact: those that its path has a line for."""
    return [s for s in expand(protocol) if s.press == press and s.target_mm[2] < 0]


def _moved(start: Any, now: Any) -> float:
    if start.displacement_mm is None or now.displacement_mm is None:
        return 0.0
    off = now.displacement_mm.astype(float) - start.displacement_mm
    return float(np.hypot(off[..., 0], off[..., 1]).max())
