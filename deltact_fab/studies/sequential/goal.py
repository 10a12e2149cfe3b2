"""Goal of a run, such as "normal 0.1N", and the looks at it that a protocol plans."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Self

from deltact_fab.bench import Press, Protocol
from deltact_fab.common import InputError, did_you_mean

from .rule import MIN_LOOK_PLACES

BLOCK_PRESSES = 8  # by hand: a look takes as long as a press or two
GOAL_UNITS = {
    **dict.fromkeys(("normal", "shear_x", "shear_y"), "N"),
    **dict.fromkeys(("torque_x", "torque_y", "torque_z"), "Nmm"),
}
"""Units by component, definition: of the components of a calibration."""
_GOAL_FORM = re.compile(r"\s*(\S+)\s+([0-9.]+(?:e-?[0-9]+)?)\s*(N ?mm|N)\s*", re.IGNORECASE)


@dataclass(frozen=True)
class RunGoal:
    """Rms error of a force model to fall below: component, limit in its unit."""

    component: str
    limit: float
    unit: str

    @classmethod
    def from_text(cls, text: str) -> Self:
        """Parse text such as "normal 0.1N". Raises InputError."""
        example = '--until "normal 0.1N"'
        match = _GOAL_FORM.fullmatch(text)
        if match is None:
            raise InputError(f"--until: {text!r}: must be a component and its error, as {example}")
        name, number, unit = match.groups()
        if name not in GOAL_UNITS:
            raise InputError(f"--until: {name!r}: no component; {did_you_mean(name, GOAL_UNITS)}")
        try:
            limit = float(number)
        except ValueError:
            limit = 0.0
        if not 0 < limit < float("inf"):
            raise InputError(f"--until: {number!r}: must be a number above 0, as {example}")
        if (unit := unit.replace(" ", "")).lower() != GOAL_UNITS[name].lower():
            raise InputError(f"--until: {name} in {unit}; its unit is {GOAL_UNITS[name]}")
        return cls(name, limit, GOAL_UNITS[name])

    @classmethod
    def from_record(cls, stored: dict[str, Any]) -> Self:
        """Goal of a recorded run."""
        return cls(stored["component"], stored["goal"], stored["unit"])

    def as_dict(self) -> dict[str, Any]:
        """Keys for the record."""
        return {"component": self.component, "goal": self.limit, "unit": self.unit}

    def require_shown_by(self, protocol: Protocol, source: str) -> None:
        """Raise InputError unless the presses of a protocol can show the goal."""
        lacking = {"image", "force"} - protocol.channels
        if lacking or protocol.weights is not None:
            need = f"channels: add {sorted(lacking)}" if lacking else "weights: laid on by hand"
            raise InputError(f"{source}: --until needs images and forces of a stage; {need}")
        presses = protocol.list_presses()
        for role in ("fit", "validate"):
            chosen = [press for press in presses if press.role == role]
            if not chosen:
                text = f'no press of role "{role}"; list presses as [[press]] with this role'
                raise InputError(f"{source}: --until: {text}")
            if not any(self.component in _varied_components(press) for press in chosen):
                text = f'no press of role "{role}" varies {self.component}; {self._remedy}'
                raise InputError(f"{source}: --until: {text}")
        if (n := count_places(presses)) < MIN_LOOK_PLACES:
            text = f"presses to validate at {n} places or tips; at least {MIN_LOOK_PLACES} show it"
            raise InputError(f"{source}: --until: {text}, mirror images being one")

    @property
    def _remedy(self) -> str:
        axis = self.component[-1]
        if self.component == "torque_z":
            return "drag it beside the centre"
        return f"drag it along {axis}" if "shear" in self.component else "press beside the centre"


def _varied_components(press: Press) -> Iterator[str]:
    """Yield the components that a press varies about the centre of the face."""
    x, y = (abs(value) > 0 for value in press.at_mm)
    reaches = [press.reach_mm(depth) for depth in press.depths_mm]
    dx, dy = (any(reach[axis] > 0 for reach in reaches) for axis in (0, 1))
    flags = (True, dx, dy, y or dy, x or dx, (x or y) and (dx or dy))
    return (name for name, varies in zip(GOAL_UNITS, flags, strict=True) if varies)


def count_places(presses: Sequence[Press]) -> int:
    """Count the distinct places to validate, of each tip; mirror images are one."""
    return len({
        (press.indenter, *map(abs, press.at_mm)) for press in presses if press.role == "validate"
    })  # fmt: skip


def planned_looks(protocol: Protocol) -> list[int]:
    """Numbers of presses after which a run is looked at: after each block, and after the last.

    A block is the presses from one reference press to the next, or BLOCK_PRESSES; a reference press
    after it belongs to it.
    """
    size = protocol.reference.every if protocol.reference else BLOCK_PRESSES
    presses, looks, in_block = protocol.list_presses(), [], 0
    for n, press in enumerate(presses, start=1):
        in_block += press.role != "reference"
        following = presses[n].role if n < len(presses) else "end"
        if following == "end" or (in_block >= size and following != "reference"):
            looks.append(n)
            in_block = 0
    return looks
