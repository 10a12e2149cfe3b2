"""Fewer frames of the paper's pattern selection: fewer positions and shorter drags, equal steps.

What is never thinned is the way between two frames, which is what a tracker has to bridge, and the
presses: all depths, both axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ..protocols.plan import Protocol, expand


@dataclass(frozen=True)
class PathPart:
    """Which part of a whole protocol's path another one covers, and how densely it is filmed.

    shear_mm: its amplitude; frames: of one indenter; longest_step_mm: of the tip between two frames
    of a line.
    """

    positions: int
    of_positions: int
    depths_mm: tuple[float, ...]
    axes: tuple[str, ...]
    shear_mm: float
    of_shear_mm: float
    frames: int
    of_frames: int
    longest_step_mm: float

    @property
    def words(self) -> str:
        """One line for the head of a table's column."""
        depths = " and ".join(f"{d:g}" for d in self.depths_mm)
        return (
            f"{self.positions} of {self.of_positions} positions, {depths} mm deep, shear +-"
            f"{self.shear_mm:g} of {self.of_shear_mm:g} mm in {' and '.join(self.axes)}, "
            f"{self.frames} of {self.of_frames} frames ({self.frames / self.of_frames:.1%})"
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain data, units in the keys."""
        return {
            "positions": self.positions,
            "of_positions": self.of_positions,
            "depths_mm": list(self.depths_mm),
            "axes": list(self.axes),
            "shear_mm": self.shear_mm,
            "of_shear_mm": self.of_shear_mm,
            "frames_an_indenter": self.frames,
            "of_frames_an_indenter": self.of_frames,
            "frames_share": self.frames / self.of_frames,
            "longest_step_mm": self.longest_step_mm,
        }


def thinned(whole: Protocol, scale: float) -> Protocol:
    """A protocol with about `scale` times the frames of a whole one, 0 < scale <= 1.

    As few positions as hold them, the first ones, and of their drags so many steps as fit, at least
    one. At scale 1 it is the whole one. The step between frames is the whole one's.
    """
    if scale >= 1 or whole.shear is None or whole.shear.amplitude_mm is None:
        return whole
    wanted = scale * frames_an_indenter(whole)
    count = math.ceil(scale * len(whole.positions_mm) - 1e-9)
    rate_hz = whole.capture.rate_hz
    assert rate_hz is not None, "the paper's protocol films its drags"
    step_mm = whole.motion.shear_feed_mm_min / 60 / rate_hz
    longest = int(whole.shear.amplitude_mm / step_mm)
    fewer = whole.model_copy(update={"positions_mm": whole.positions_mm[:count]})
    if frames_an_indenter(fewer) <= wanted:
        return fewer
    one, two = (frames_an_indenter(_dragged(fewer, n * step_mm)) for n in (1, 2))
    steps = round((wanted - one) / (two - one)) + 1
    return _dragged(fewer, min(max(steps, 1), longest) * step_mm)


def _dragged(protocol: Protocol, amplitude_mm: float) -> Protocol:
    """With drags of this many mm, to the micrometre."""
    assert protocol.shear is not None
    shear = protocol.shear.model_copy(update={"amplitude_mm": round(amplitude_mm, 3)})
    return protocol.model_copy(update={"shear": shear})


def frames_an_indenter(protocol: Protocol) -> int:
    """Frames of the first indenter; the others have as many."""
    first = protocol.model_copy(update={"indenters": protocol.indenters[:1]})
    return sum(step.frames for step in expand(first))


def part_of(whole: Protocol, protocol: Protocol) -> PathPart:
    """The part of the whole protocol's path that a thinned one covers."""
    shear, of_shear = protocol.shear, whole.shear
    return PathPart(
        positions=len(protocol.positions_mm),
        of_positions=len(whole.positions_mm),
        depths_mm=protocol.depths_mm,
        axes=shear.axes if shear else (),
        shear_mm=(shear.amplitude_mm or 0.0) if shear else 0.0,
        of_shear_mm=(of_shear.amplitude_mm or 0.0) if of_shear else 0.0,
        frames=frames_an_indenter(protocol),
        of_frames=frames_an_indenter(whole),
        longest_step_mm=longest_step_mm(protocol),
    )


def longest_step_mm(protocol: Protocol) -> float:
    """Longest way of the tip between two frames of a press or drag."""
    longest, here = 0.0, (0.0, 0.0, 0.0)
    for step in expand(protocol):
        if step.frames and step.kind in ("press", "shear"):
            longest = max(longest, math.dist(here, step.target_mm) / step.frames)
        here = step.target_mm
    return longest
