"""Every part by name, with what a bill of materials needs. Imports no CAD kernel."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..errors import InputError, did_you_mean
from ..shapes.indenter import KINDS, parse
from .design import IndenterDimensions, IndenterList, load_indenters

RESIN = "Formlabs tough epoxy resin"
PRINT = "SLA print"
BOUGHT = "bought"
PARTS = "deltact_fab.cad.parts"
GROUPS = ("sensor", "tools", "bench", "indenters")


@dataclass(frozen=True)
class Part:
    """One part.

    builder: import string `module:function`; the function takes the dimensions and returns one
    solid, and its module's `expect` states what that solid must be.
    quantity: pieces for one sensor, one mold or one test bench.
    group: one of GROUPS. number: as in the paper's exploded view, 0 for what it does not number.
    sections: sections of a design whose dimensions the part is made from.
    explode_mm: shift along z in the exploded view.
    colour: sRGB and opacity in pictures.
    indenter: the dimensions of an indenter, None for everything else.
    """

    name: str
    builder: str
    material: str
    process: str
    quantity: int = 1
    group: str = "sensor"
    number: int = 0
    sections: tuple[str, ...] = ()
    explode_mm: float = 0.0
    colour: tuple[float, float, float, float] = (0.75, 0.75, 0.75, 1.0)
    indenter: IndenterDimensions | None = None


BLACK = (0.12, 0.12, 0.13, 1.0)
WHITE = (0.93, 0.93, 0.90, 1.0)
CLEAR = (0.62, 0.80, 0.92, 0.35)
STEEL = (0.62, 0.64, 0.66, 1.0)
GREEN = (0.13, 0.42, 0.25, 1.0)
AMBER = (0.85, 0.60, 0.25, 1.0)

SENSOR_PARTS = (
    Part("skin", f"{PARTS}.skin:build", "Solaris silicone, Shore 15A, clear, 1:1",
         "cast in the mold", sections=("skin", "frame", "screw", "shell"), explode_mm=46,
         colour=CLEAR),
    Part("skin-frame", f"{PARTS}.skin_frame:build", f"{RESIN}, black", PRINT, number=1,
         sections=("skin", "frame", "optics", "screw", "shell"), explode_mm=28, colour=BLACK),
    Part("acrylic", f"{PARTS}.acrylic:build", "cast PMMA, clear", "laser cut", number=2,
         sections=("skin", "frame", "optics", "screw", "shell"), explode_mm=14, colour=CLEAR),
    Part("shell", f"{PARTS}.shell:build", f"{RESIN}, black", PRINT, number=3,
         sections=("shell", "mount", "screw", "skin", "frame"), colour=BLACK),
    Part("light-holder", f"{PARTS}.light_holder:build", f"{RESIN}, white, translucent", PRINT,
         number=4, sections=("light", "shell", "holder", "camera"), explode_mm=-28, colour=WHITE),
    Part("camera", f"{PARTS}.camera:build", "IMX219 board with a 200 degree lens", BOUGHT, number=5,
         sections=("camera", "optics"), explode_mm=-48, colour=GREEN),
    Part("camera-screw", f"{PARTS}.screw:build_camera_screw", "steel, ISO 1207", BOUGHT, 2,
         sections=("holder",), explode_mm=-41, colour=STEEL),
    Part("camera-holder", f"{PARTS}.camera_holder:build", f"{RESIN}, black", PRINT, number=6,
         sections=("holder", "camera", "cover", "shell"), explode_mm=-64, colour=BLACK),
    Part("cover", f"{PARTS}.cover:build", f"{RESIN}, black", PRINT, number=7,
         sections=("cover", "screw", "shell"), explode_mm=-78, colour=BLACK),
    Part("screw", f"{PARTS}.screw:build", "steel, ISO 4762", BOUGHT, 4, number=8,
         sections=("screw",), explode_mm=-104, colour=STEEL),
)  # fmt: skip

TOOL_PARTS = (
    Part("mold", f"{PARTS}.mold:build", RESIN, PRINT, group="tools",
         sections=("mold", "skin", "frame"), colour=AMBER),
    Part("coupon-mold", f"{PARTS}.coupon_mold:build", RESIN, PRINT, group="tools",
         sections=("coupon",), colour=AMBER),
)  # fmt: skip

BENCH_PARTS = (
    Part("testing-shell", f"{PARTS}.shell:build_testing", f"{RESIN}, black", PRINT, group="bench",
         sections=("shell", "table", "screw", "skin", "frame"), colour=BLACK),
    Part("transparent-base", f"{PARTS}.skin_frame:build", f"{RESIN}, black", PRINT, group="bench",
         sections=("skin", "frame", "optics", "screw", "shell"), colour=BLACK),
)  # fmt: skip


def listed(indenters: IndenterList | None = None) -> list[Part]:
    """Every part: sensor, tools, bench, and the indenters of the list (cad/indenters.toml)."""
    known = load_indenters() if indenters is None else indenters
    return [
        *SENSOR_PARTS,
        *TOOL_PARTS,
        *BENCH_PARTS,
        *(_indenter(entry.name, known, entry.quantity) for entry in known.indenter),
    ]


def find(name: str, indenters: IndenterList | None = None) -> Part:
    """One part by name; an indenter also by its name in a protocol, and in any size.

    `indenter-sphere-12p5`, `sphere:12.5`, `star`, `star:8` and `indenter-star-8` all exist.
    Raises InputError with the nearest known name, or stating the sizes that are valid.
    """
    known = load_indenters() if indenters is None else indenters
    parts = {part.name: part for part in listed(known)}
    if name in parts:
        return parts[name]
    # `indenter-sphere-12p5` and `indenter-sphere-12.5` are what `sphere:12.5` is called as a file.
    short = name.removeprefix("indenter-").replace("-", ":", 1)
    kind, colon, size = short.partition(":")
    if kind not in KINDS or (colon and not size) or (kind == "sphere" and not size):
        names = [*parts, *GROUPS, *KINDS]
        raise InputError(f"part {name!r}: unknown; {did_you_mean(name, names)}")
    part = _indenter(f"{kind}{colon}{size.replace('p', '.')}", known)
    return parts.get(part.name, part)


def select(names: Iterable[str], indenters: IndenterList | None = None) -> list[Part]:
    """The named parts in the order given, each once; every part when none is named.

    A name of GROUPS stands for all of its parts.
    """
    known = load_indenters() if indenters is None else indenters
    every = listed(known)
    wanted: dict[str, Part] = {}
    for name in names:
        of_group = [part for part in every if part.group == name]
        for part in of_group or [find(name, known)]:
            wanted[part.name] = part
    return list(wanted.values()) or every


def _indenter(name: str, known: IndenterList, quantity: int = 1) -> Part:
    indenter = parse(name)
    return Part(
        f"indenter-{indenter.slug}",
        "deltact_fab.cad.parts.indenter:build",
        RESIN,
        PRINT,
        quantity,
        group="indenters",
        colour=WHITE,
        indenter=IndenterDimensions(indenter, known.body),
    )
