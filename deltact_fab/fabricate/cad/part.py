"""The definition of a part: everything the toolchain needs, in one value. Imports no CAD kernel.

A file of parts/ lists its parts in `PARTS`. Checks, drawings, bill of materials, assembly, guide
and export all use this record, so that a new part is one new file. Its dimensions are a section
record and a field of Design.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from deltact_fab.common import Check

    from .design import IndenterDimensions
    from .dimensions import Design
    from .drafting.dimensioning import Callouts
    from .kernel import Extent
    from .rule import PlayFit

Group = Literal["sensor", "electronics", "tools", "bench", "indenters"]
PART_GROUPS: tuple[Group, ...] = ("sensor", "electronics", "tools", "bench", "indenters")
PER_SENSOR: tuple[Group, ...] = ("sensor", "electronics")
Shift = tuple[float, float, float]

# The paper: "tough epoxy resin" of Formlabs; cad/parts.toml has a product.
RESIN_MATERIAL = "tough SLA resin"
PRINT_PROCESS = "SLA print"
BOUGHT_PROCESS = "bought"
LASER_CUT = "laser cut"
MACHINED_PROCESS = "machined"

# By hand, colours of the materials in pictures: darker ones hide edges.
BLACK_RGBA = (0.12, 0.12, 0.13, 1.0)
WHITE_RGBA = (0.93, 0.93, 0.90, 1.0)
CLEAR_RGBA = (0.62, 0.80, 0.92, 0.35)
STEEL_RGBA = (0.62, 0.64, 0.66, 1.0)
GREEN_RGBA = (0.13, 0.42, 0.25, 1.0)
AMBER_RGBA = (0.85, 0.60, 0.25, 1.0)

PlatformSide = Literal["-z", "+z"]
Matrix = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]

# Turns, exact, by the side of the part's own frame that comes to face the platform.
_DOWN_TURNS: dict[str, Matrix] = {
    "-z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "+z": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
}

SELF_SUPPORTING_DEG = 19.0
"""Smallest slope to the platform that SLA prints without support: by hand, from service bureaus'
design guides for stereolithography (after Formlabs); a printer's own may differ."""


@dataclass(frozen=True)
class PrintPose:
    """Pose of a printed part on the platform, for its files, the checks and the guide.

    Platform frame: z away from it, every part at z >= 0; x, y along its sides.
    down: the side of the part's frame that faces the platform; face: name of that side.
    tilt_deg: subsequent rotation about the platform's x, which lifts the side at +y; 90: the part
    stands on its side at -y, which `face` names. A part tilted by less stands on supports and does
    not touch the platform. supports: where they are allowed; empty: nowhere.
    """

    down: PlatformSide = "-z"
    face: str = "underside"
    tilt_deg: float = 0.0
    supports: str = ""

    @property
    def turn(self) -> Matrix:
        """Rotation matrix from the part's frame to the platform's; exact without tilt."""
        down = _DOWN_TURNS[self.down]
        if not self.tilt_deg:
            return down
        turn = math.radians(self.tilt_deg)
        c, s = round(math.cos(turn), 15), round(math.sin(turn), 15)  # 90 degrees are exact
        x, y, z = down
        lower = tuple(c * b - s * a for a, b in zip(z, y, strict=True))
        upper = tuple(s * b + c * a for a, b in zip(z, y, strict=True))
        return x, (lower[0], lower[1], lower[2]), (upper[0], upper[1], upper[2])

    @property
    def on_supports(self) -> bool:
        """True if the part stands on supports, clear of the platform."""
        return self.tilt_deg not in (0.0, 90.0)

    @property
    def instructions(self) -> str:
        """Instruction for printing."""
        if self.on_supports:
            return f"{self.face} down, tilted by {self.tilt_deg:g}°, supports {self.supports}"
        how = f"supports {self.supports}" if self.supports else "no supports"
        return f"{self.face} down, straight on the platform, {how}"

    def size_mm(self, low: tuple[float, ...], high: tuple[float, ...]) -> tuple[float, ...]:
        """Sides (x, y, z) in this pose, from the part's box; an upper bound if tilted."""
        sides = [b - a for a, b in zip(low, high, strict=True)]
        return tuple(sum(abs(t) * s for t, s in zip(row, sides, strict=True)) for row in self.turn)


def no_entries(design: Design) -> tuple[()]:
    """Return no rules and no fits."""
    return ()


def in_its_place(design: Design) -> list[Shift]:
    """Return the position of one piece built in place."""
    return [(0.0, 0.0, 0.0)]


@dataclass(frozen=True)
class Dimension:
    """One independent value. low, high: its bounds; None if it is not a bounded number."""

    key: str
    value: Any
    meaning: str
    low: float | None = None
    high: float | None = None
    unverified: bool = False

    @property
    def row(self) -> tuple[str, str, str, str]:
        """Key, value, limits and meaning for a table; numbers with six digits."""
        key = self.key + (" (unverified)" if self.unverified else "")
        limits = "" if self.low is None else f"{self.low:g} to {self.high:g}"
        if isinstance(self.value, dict):
            lengths = ", ".join(f"{name} {number}" for name, number in self.value.items())
            return key, "", "", f"{self.meaning}: {lengths}"
        value = f"{self.value:.6g}" if isinstance(self.value, float) else str(self.value)
        return key, value, limits, self.meaning


@dataclass(frozen=True)
class Part:
    """One part.

    name: unique; files are named after it. build: from dimensions to one solid of the CAD kernel.
    box: from the same dimensions to that solid's bounding box. Both take a Design, or for an
    indenter its `indenter`. quantity: pieces for one sensor, one mold or one test bench.
    spares: further pieces to order, once. number: in the paper's exploded view, 0 if not numbered.
    explode_mm: shift along z in the exploded view; also orders the parts of a group, face first.
    colour: sRGB and opacity in pictures. places: translations of its pieces in the sensor. fits:
    its mating pairs with other parts, each pair listed by one of the two. sections: sections of a
    design that it is made from. derived: lengths of Design that it uses. rules: its inequalities.
    wall_keys: keys of its designed wall thicknesses, of which the smallest counts; the process may
    require more. in_view: it is between lens and face and could obstruct the view. callouts:
    content of its drawing; None without a drawing. note: in the bill of materials, with values of
    the design in braces (`{d.table.screw} screws`), or a function. pose: on the printer. how:
    further instructions for making it; look_for: inspection afterwards.
    """

    name: str
    build: Callable[[Any], Any]
    box: Callable[[Any], Extent]
    material: str = f"{RESIN_MATERIAL}, black"
    process: str = PRINT_PROCESS
    quantity: int = 1
    spares: int = 0
    group: Group = "sensor"
    number: int = 0
    explode_mm: float = 0.0
    colour: tuple[float, float, float, float] = (0.75, 0.75, 0.75, 1.0)
    places: Callable[[Design], list[Shift]] = in_its_place
    sections: tuple[str, ...] = ()
    derived: tuple[str, ...] = ()
    rules: Callable[[Design], Iterable[Check]] = no_entries
    fits: Callable[[Design], Iterable[PlayFit]] = no_entries
    wall_keys: tuple[str, ...] = ()
    in_view: bool = False
    callouts: Callable[[Any], Callouts] | None = None
    note: str | Callable[[Design], str] = ""
    pose: PrintPose = PrintPose()
    how: str = ""
    look_for: str = ""
    indenter: IndenterDimensions | None = None

    def source(self, design: Design) -> Any:
        """Return the argument of `build`, `box` and `callouts`."""
        return design if self.indenter is None else self.indenter

    def note_text(self, design: Design) -> str:
        """Return the note for a design."""
        return self.note.format(d=design) if isinstance(self.note, str) else self.note(design)

    @property
    def per_sensor(self) -> bool:
        """True if `quantity` is per sensor, else per lab."""
        return self.group in PER_SENSOR

    @property
    def printed(self) -> bool:
        """True if it is printed, in its `pose`."""
        return self.process == PRINT_PROCESS

    @property
    def making(self) -> str:
        """Instruction for making it."""
        texts = (self.pose.instructions if self.printed else "", self.how)
        return "; ".join(words for words in texts if words) or self.process

    def dimensions(self, design: Design) -> Iterator[Dimension]:
        """Yield all dimensions of the part, also for a design that breaks a rule."""
        if self.indenter is not None:
            yield from _indenter_dimensions(self.indenter)
            return
        unverified = design.unverified()
        for section in self.sections:
            record = getattr(design, section)
            for f in fields(record):
                key, meta = f"{section}.{f.name}", f.metadata
                about = meta.get("description", ""), meta.get("ge"), meta.get("le")
                yield Dimension(key, getattr(record, f.name), *about, key in unverified)


def _indenter_dimensions(dims: IndenterDimensions) -> Iterator[Dimension]:
    shape = dims.indenter
    yield Dimension("plate_mm", dims.body.plate_mm, "back plate")
    yield Dimension("stem_diameter_mm", shape.stem_diameter_mm, "stem, for the tool holder")
    yield Dimension("stem_length_mm", shape.stem_length_mm, "stem above the plate")
    yield Dimension("reach_mm", shape.reach_mm, "free length of the tips below the plate")
    for number, tip in enumerate(shape.tips, 1):
        kind = type(tip).__name__.removesuffix("Tip").lower()
        yield Dimension(f"tip{number}", asdict(tip), kind)
