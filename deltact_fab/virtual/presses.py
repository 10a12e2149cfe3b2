"""One press of a protocol as the stage drives it, and the solver of its path."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .. import cache
from ..aliases import Field, Point
from ..elasticity.material import GelMaterial
from ..errors import InputError
from ..gel.path.knots import Increments, KnotPose, ObservedChannels
from ..gel.path.open import choose, open_path
from ..gel.path.solver import KIND, PathSolver
from ..levels import LINEAR
from ..protocols.plan import Protocol
from ..rig.simulator import GelConfig
from ..shapes import SkinDimensions
from ..shapes.indenter import parse as parse_indenter
from .paths import PressPath, paths, poses

if TYPE_CHECKING:
    from ..gel.level import Choice, Level


SAME_MM = 2e-3  # a point of the stage is the plan's within a motor step and its rounding


@dataclass(frozen=True, eq=False)
class PlannedPress:
    """solver: of the path's knots. name: `indenter/position`. waypoints: ends of its lines."""

    solver: PathSolver
    name: str = ""
    waypoints: tuple[Point, ...] = ()

    def snapped(self, point: Point) -> Point:
        """The planned point that this one is but for a motor step, else the point itself."""
        for planned in self.waypoints:
            if all(abs(p - q) <= SAME_MM for p, q in zip(planned, point, strict=True)):
                return planned
        return point

    def rest_after(self, key: int) -> float | None:
        """Seconds that the tip rests after a planned knot before the next; None: no knot for it."""
        poses = self.solver.poses
        if 0 < key < len(poses) and poses[key].part == 0:
            return poses[key].seconds
        return None


class Presses:
    """Opens the presses of a protocol on a skin; keeps count of what was solved and what found.

    One press is under way at a time: opening the next closes it.
    Nothing that no channel needs: no friction without shear, no field without images, no time
    without a Prony series.
    """

    def __init__(self, protocol: Protocol, skin: SkinDimensions, config: GelConfig) -> None:
        specimen = protocol.specimen
        self.level: Level = specimen.gel_model
        self.modulus_mpa = specimen.modulus_mpa
        self.shears = "shear" in protocol.channels
        self.fields = "image" in protocol.channels
        self.observed = not protocol.channels.isdisjoint(("image", "force"))
        self.tractions = "traction" in protocol.channels
        self.relaxing_s = tuple(tau for g, tau in specimen.prony if g > 0)
        self.material = GelMaterial(1.0, specimen.poisson, specimen.friction, specimen.prony)
        self.paths = paths(protocol)
        self.opened: list[PlannedPress] = []
        self._skin = skin
        finite = config.hyperelastic
        lattice_mm, self.increments = (
            (
                config.spacing_mm or finite.lattice_mm,
                Increments(config.press_increment_mm, config.shear_increment_mm),
            )
            if self.level == LINEAR
            else (
                finite.lattice_mm,
                Increments(finite.press_increment_mm, finite.shear_increment_mm),
            )
        )
        self._shown = ObservedChannels(
            "all" if self.fields else "none",
            traction=self.tractions,
            lattice_mm=lattice_mm,
        )
        self._wishes: dict[str, Any] = {
            "tolerance": finite.tolerance,
            "level": self.level,
            "observe_shear": self.shears,
            "spacing_mm": config.spacing_mm if self.level == LINEAR else finite.cell_mm,
            "most_unknowns": finite.most_unknowns,
        }
        self._waiting: dict[str, PlannedPress] = {}

    def axes_mm(self) -> tuple[Field, Field]:
        """The lattice's nodes along x and y, the same for all presses."""
        first = self.paths[0]
        press = self._waiting[first.press] = self._press(first)
        return press.solver.axes_mm

    def open(self, indenter: str, at_mm: tuple[float, float]) -> PlannedPress:
        """The planned press of an indenter at a place. Raises InputError where there is none."""
        for path in self.paths:
            there = all(abs(a - b) <= SAME_MM for a, b in zip(path.at_mm, at_mm, strict=True))
            if path.indenter == indenter and there:
                return self.of(path)
        raise InputError(f"no press of {indenter} is planned at ({at_mm[0]:g}, {at_mm[1]:g}) mm")

    def of(self, path: PressPath) -> PlannedPress:
        waiting = self._waiting.pop(path.press, None)
        return self._opened(waiting or self._press(path))

    def _opened(self, press: PlannedPress) -> PlannedPress:
        if self.opened:
            self.opened[-1].solver.close()
        self.opened.append(press)
        return press

    def choice(self, path: PressPath) -> Choice:
        """Mesh and friction of a planned press. Raises InputError where the level has none."""
        return self._choose(path, poses(path, self.increments, self.relaxing_s))

    def _press(self, path: PressPath) -> PlannedPress:
        planned = poses(path, self.increments, self.relaxing_s)
        shape, choice = parse_indenter(path.indenter), self._choose(path, planned)
        solver = open_path(self._skin, self.material, shape, planned, self._shown, choice)
        return PlannedPress(solver, path.press, path.waypoints)

    def _choose(self, path: PressPath, planned: Sequence[KnotPose]) -> Choice:
        shape = parse_indenter(path.indenter)
        return choose(self._skin, self.material, shape, planned, **self._wishes)


def stored_files(press: PlannedPress) -> tuple[str, ...]:
    """Name of the file of the store that has all of a press, if it is there."""
    key = press.solver.stored_as
    return () if key is None else (str(cache.file_of(KIND, json.loads(key))),)


def path_of(presses: Presses, name: str) -> PressPath:
    """A planned press by its name, as `sphere-10/p1`. Raises InputError."""
    for path in presses.paths:
        if path.press == name:
            return path
    known = ", ".join(path.press for path in presses.paths)
    raise InputError(f"no press {name!r}; valid: {known}")
