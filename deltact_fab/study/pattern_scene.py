"""What a pattern selection simulates, split into jobs.

A press of the gel is solved once and serves all patterns and all presses that are its mirror
images; a press is drawn and tracked under all patterns in one job, which shares its geometry.

What is never thinned is the way between two frames, which is what a tracker has to bridge, and the
presses: all depths, both axes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ..cad.design import load_design
from ..errors import InputError, did_you_mean
from ..patterns.series import SeriesEntry, recipes
from ..protocols import plan
from ..protocols.plan import Protocol, expand
from ..rig.config import VirtualConfig
from ..shapes import SensorDimensions
from ..shapes.indenter import parse as parse_indenter
from ..virtual.paths import paths
from ..virtual.presses import Presses
from . import press_jobs
from .grid import GridJob
from .pattern_errors import METHODS
from .pattern_press import KNOT_S, cost_s, follow
from .request import StudyRequest, virtual_rig


class PathPart(NamedTuple):
    """Which part of a whole protocol's path another one covers, and how densely it is filmed.

    words: one line. longest_step_mm: of the tip between two frames of a line.
    """

    words: str
    positions: int
    frames_an_indenter: int
    frames_share: float
    longest_step_mm: float


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
    frames, of_frames = frames_an_indenter(protocol), frames_an_indenter(whole)
    positions, share = len(protocol.positions_mm), frames / of_frames
    words = (
        f"{positions} of {len(whole.positions_mm)} positions, "
        f"{' and '.join(f'{d:g}' for d in protocol.depths_mm)} mm deep, "
    )
    if protocol.shear and whole.shear:
        words += (
            f"shear +-{protocol.shear.amplitude_mm or 0:g} of {whole.shear.amplitude_mm or 0:g} mm "
            f"in {' and '.join(protocol.shear.axes)}, "
        )
    words += f"{frames} of {of_frames} frames ({share:.1%})"
    return PathPart(words, positions, frames, share, longest_step_mm(protocol))


def longest_step_mm(protocol: Protocol) -> float:
    """Longest way of the tip between two frames of a press or drag."""
    longest, here = 0.0, (0.0, 0.0, 0.0)
    for step in expand(protocol):
        if step.frames and step.kind in ("press", "shear"):
            longest = max(longest, math.dist(here, step.target_mm) / step.frames)
        here = step.target_mm
    return longest


PROTOCOL, RIG = "pattern-selection", "virtual"
SCALE = 0.04
"""Default: 136 of 3600 frames an indenter, some 40 minutes on two cores with the gel solved."""
PATTERNS = 4
"""Of a job, at most: each takes some 80 MB, and so many share a frame's geometry well enough."""


@dataclass(frozen=True)
class Selection:
    """The scene of one study: what is pressed, drawn and followed."""

    protocol: Protocol
    part: PathPart
    sensor: SensorDimensions
    config: VirtualConfig
    source: Path
    entries: tuple[SeriesEntry, ...]
    seed: int

    @classmethod
    def of(cls, asked: StudyRequest) -> Selection:
        """As requested. Raises InputError for a real rig or unknown names."""
        whole, _ = plan.load(str(asked.more.get("protocol") or PROTOCOL))
        config, source = virtual_rig(asked.rig or RIG)
        indenters = _chosen(
            "--indenter",
            [parse_indenter(name).name for name in asked.more.get("indenter") or ()],
            list(whole.indenters),
        )
        every = {entry.name: entry for entry in recipes(asked.seed)}
        chosen = _chosen("--pattern", list(asked.more.get("pattern") or ()), list(every))
        protocol = thinned(whole, SCALE if asked.scale is None else asked.scale)
        protocol = protocol.model_copy(update={"indenters": tuple(indenters)})
        return cls(
            protocol,
            part_of(whole, protocol),
            load_design(protocol.specimen.design),
            config,
            source,
            tuple(every[name] for name in chosen),
            asked.seed,
        )

    @property
    def presses(self) -> Presses:
        """On the rig's gel."""
        return Presses(self.protocol, self.sensor.skin, self.config.virtual.gel)

    def gel_jobs(self) -> list[GridJob]:
        """See `press_jobs.gel_jobs`."""
        return press_jobs.gel_jobs(self.presses, partial(self._given, entries=()), KNOT_S)

    def jobs(self, workers: int = 1) -> list[GridJob]:
        """A press with some patterns each, which share its geometry; a part for every worker."""
        gel, count = self.presses, len(self.entries)
        parts = min(max(workers, math.ceil(count / PATTERNS)), count)
        frames = self.part.frames_an_indenter // self.part.positions
        return [
            GridJob(
                f"{press} ({k + 1} of {parts})", follow,
                self._given(press, self.entries[k::parts]),
                cost_s(frames, len(self.entries[k::parts])),
                press_jobs.gel_files(gel, [press]),
            )
            for press in [path.press for path in gel.paths]
            for k in range(parts)
        ]  # fmt: skip

    def _given(self, press: str, entries: Sequence[SeriesEntry]) -> dict[str, Any]:
        patterns = {entry.name: entry.recipe.model_dump(mode="json") for entry in entries}
        indenter = next(p.indenter for p in paths(self.protocol) if p.press == press)
        # A press does not depend on the other indenters: with more of them it is found again.
        alone = self.protocol.model_copy(update={"indenters": (indenter,)})
        return press_jobs.given(
            alone, self.sensor, self.config, self.source, press=press, patterns=patterns,
            methods=list(METHODS), seed=self.seed,
        )  # fmt: skip


def _chosen(option: str, asked: list[str], known: list[str]) -> list[str]:
    """Those asked for in the order of those known, all where none is. Raises InputError."""
    for name in asked:
        if name not in known:
            raise InputError(f"{option}: {name!r}: not in this study; {did_you_mean(name, known)}")
    return [name for name in known if not asked or name in asked]
