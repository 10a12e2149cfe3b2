"""The presses of a protocol on a skin: which mesh, which store, which mirror image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gel.material import GelMaterial
from ..protocols.plan import Protocol
from ..rig.simulator import GelConfig
from ..shapes import Indenter, SkinDimensions
from ..shapes.indenter import parse as parse_indenter
from .mirror import to_solved
from .press import SAME_MM, Press
from .trajectory import VERSION, Between, Increments, Line, PressPath, paths, poses

if TYPE_CHECKING:
    from ..gel.choose import Choice
    from ..gel.level import GelContact, Level

Field = NDArray[np.float64]
Box = tuple[tuple[float, float], tuple[float, float], float]

LINEAR = ("layer", "block")


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
        self.timed = bool(specimen.prony)
        self.material = GelMaterial(1.0, specimen.poisson, specimen.friction, specimen.prony)
        self.paths = paths(protocol)
        self.opened: list[Press] = []
        self._skin, self._config = skin, config
        finite = config.hyperelastic
        self._lattice_mm, self.increments = (
            (config.spacing_mm, Increments(config.press_increment_mm, config.shear_increment_mm))
            if self.level in LINEAR
            else (
                finite.lattice_mm,
                Increments(finite.press_increment_mm, finite.shear_increment_mm),
            )
        )
        self._deepest_mm = max(protocol.depths_mm)
        self._amplitude_mm = protocol.shear.amplitude_mm if protocol.shear else 0.0
        self._waiting: dict[str, Press] = {}

    def axes_mm(self) -> tuple[Field, Field]:
        """The lattice's nodes along x and y, the same for all presses."""
        first = self.paths[0]
        press = self._waiting[first.press] = self._press(first)
        return press.axes_mm

    def open(self, indenter: str, at_mm: tuple[float, float]) -> Press:
        """The press of an indenter at a place; one that is not planned is solved and not kept."""
        for path in self.paths:
            there = all(abs(a - b) <= SAME_MM for a, b in zip(path.at_mm, at_mm, strict=True))
            if path.indenter == indenter and there:
                return self.of(path)
        a = self._amplitude_mm
        half = self._skin.opening_half_mm
        x, y = ((max(v - a, -h), min(v + a, h)) for v, h in zip(at_mm, half, strict=True))
        shape = parse_indenter(indenter)
        choice = self._pick(shape, (x, y, self._deepest_mm))
        floor_mm = self._skin.thickness_mm
        return self._opened(
            Press(self._opener(shape, choice), fields=self.fields, floor_mm=floor_mm)
        )

    def of(self, path: PressPath) -> Press:
        """A planned press."""
        waiting = self._waiting.pop(path.press, None)
        return self._opened(waiting or self._press(path))

    def _opened(self, press: Press) -> Press:
        if self.opened:
            self.opened[-1].close()
        self.opened.append(press)
        return press

    @property
    def between(self) -> Between:
        """Worst interpolation of the presses opened, forces for a modulus of 1 MPa."""
        worst = Between()
        for press in self.opened:
            worst = worst.joined(press.between)
        return worst

    def choice(self, path: PressPath) -> Choice:
        """Mesh and friction of a planned press. Raises InputError where the level has none.

        Of the press's mirror image, where that is solved instead.
        """
        indenter = parse_indenter(path.indenter)
        return self._pick(indenter, to_solved(path, indenter).path(path).box_mm)

    def _press(self, path: PressPath) -> Press:
        indenter, choice = parse_indenter(path.indenter), self.choice(path)
        mirror = to_solved(path, indenter)
        return Press(
            self._opener(indenter, choice),
            poses(path, self.increments, self.timed),
            path.waypoints,
            self._key(mirror.path(path), indenter, choice),
            self.fields,
            path.press,
            mirror,
            self._skin.thickness_mm,
        )

    def _key(self, path: PressPath, indenter: Indenter, choice: Choice) -> dict[str, Any]:
        material, skin = self.material, self._skin
        return {
            "version": VERSION,
            "skin": [skin.width_mm, skin.length_mm, skin.thickness_mm],
            "poisson": material.poisson,
            "friction": choice.friction,
            "prony": material.prony,
            "indenter": repr(indenter),
            "level": choice.level,
            "spacing_mm": choice.spacing_mm,
            "mirrors": choice.mirrors,
            # The linear levels' grids know no focus.
            "focus": None if choice.level in LINEAR else choice.focus,
            # It parts long increments, see `gel.finite.gel`.
            "step_mm": None if choice.level in LINEAR else choice.step_mm,
            "lattice_mm": self._lattice_mm,
            "increments": asdict(self.increments),
            "lines": [_untimed(line, self.timed) for line in path.lines],
            "fields": self.fields,
        }

    def _pick(self, indenter: Indenter, box: Box) -> Choice:
        from ..gel.choose import pick
        from ..gel.level import Reach

        finite = self._config.hyperelastic
        return pick(
            self._skin,
            self.material,
            indenter,
            Reach(*box),
            finite.tolerance,
            level=self.level,
            observe_shear=self.shears,
            spacing_mm=self._config.spacing_mm if self.level in LINEAR else finite.cell_mm,
            most_unknowns=finite.most_unknowns,
        )

    def _opener(self, indenter: Indenter, choice: Choice) -> Callable[[], GelContact]:
        def opened() -> GelContact:
            from ..gel.level import contact_of

            return contact_of(self._skin, self.material, indenter, choice, self._lattice_mm)

        return opened


def path_of(presses: Presses, name: str) -> PressPath:
    """A planned press by its name, as `sphere-10/p1`. Raises InputError."""
    for path in presses.paths:
        if path.press == name:
            return path
    known = ", ".join(path.press for path in presses.paths)
    raise InputError(f"no press {name!r}; valid: {known}")


def _untimed(line: Line, timed: bool) -> list[Any]:
    """A line as the store's key has it: feeds and rests only matter to a gel that creeps."""
    return [line.start_mm, line.end_mm, *((line.seconds, line.dwell_s) if timed else ())]
