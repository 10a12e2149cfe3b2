"""What a pattern selection simulates, split into jobs.

A press of the gel is solved once and serves all patterns and all presses that are its mirror
images; a press is drawn and tracked under all patterns in one job, which shares its geometry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..cad.design import load_design
from ..errors import InputError, did_you_mean
from ..patterns.series.job import SeriesEntry, recipes
from ..protocols import plan
from ..protocols.plan import Protocol
from ..rig import config as rig_config
from ..rig.config import VirtualConfig
from ..shapes import SensorDimensions
from ..shapes.indenter import parse as parse_indenter
from ..virtual.paths import paths
from ..virtual.presses import Presses
from .grid import GridJob
from .pattern_press import KNOT_S, cost_s, follow, given, solve_gel
from .request import StudyRequest
from .thinning import PathPart, part_of, thinned

PROTOCOL, RIG = "pattern-selection", "virtual"
SCALE = 0.04
"""Default: 136 of 3600 frames an indenter, some 40 minutes on two cores with the gel solved."""
METHODS = ("paper", "fused")
"""The paper's tracker, and ours."""


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
        config, source = rig_config.load(asked.rig or RIG)
        if not isinstance(config, VirtualConfig):
            raise InputError(
                f"--rig: {source}: a real rig; the study simulates: give a virtual one, or "
                "--from with the runs of a real one"
            )
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

    def gel_jobs(self) -> list[GridJob]:
        """A job for each press that is not in the store; one stands for its mirror images."""
        presses = Presses(self.protocol, self.sensor.skin, self.config.virtual.gel)
        jobs: dict[str, GridJob] = {}
        for path in presses.paths:
            solver = presses.of(path).solver
            if solver.found is None and solver.stored_as is not None:
                cost = KNOT_S * len(solver.poses)
                told = self._given(path.press, ())
                jobs.setdefault(
                    solver.stored_as, GridJob(f"gel {path.press}", solve_gel, told, cost)
                )
        return list(jobs.values())

    def jobs(self) -> list[GridJob]:
        """A job a press, with all patterns; of an odd number of presses the last in two halves.

        So two processes have equal shares, and hardly any geometry is found twice.
        """
        presses = [path.press for path in paths(self.protocol)]
        half = (len(self.entries) + 1) // 2
        found = []
        for number, press in enumerate(presses, start=1):
            odd = number == len(presses) and number % 2 and half < len(self.entries)
            groups = (self.entries[:half], self.entries[half:]) if odd else (self.entries,)
            for k, group in enumerate(groups, start=1):
                name = f"{press} ({k} of {len(groups)})" if len(groups) > 1 else press
                frames = self.part.frames // self.part.positions
                cost = cost_s(frames, len(group))
                found.append(GridJob(name, follow, self._given(press, group), cost))
        return found

    def _given(self, press: str, entries: Sequence[SeriesEntry]) -> dict[str, Any]:
        patterns = {entry.name: entry.recipe for entry in entries}
        indenter = next(p.indenter for p in paths(self.protocol) if p.press == press)
        # A press does not depend on the other indenters: with more of them it is found again.
        alone = self.protocol.model_copy(update={"indenters": (indenter,)})
        return given(
            alone, press, self.sensor, self.config, self.source, patterns, METHODS,
            self.seed,
        )  # fmt: skip


def _chosen(option: str, asked: list[str], known: list[str]) -> list[str]:
    """Those asked for in the order of those known, all where none is. Raises InputError."""
    for name in asked:
        if name not in known:
            raise InputError(f"{option}: {name!r}: not in this study; {did_you_mean(name, known)}")
    return [name for name in known if not asked or name in asked]
