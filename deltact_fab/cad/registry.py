"""Every part by name, with what a bill of materials needs. Imports no CAD kernel."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..errors import InputError, did_you_mean
from ..shapes.indenter import KINDS, parse
from .design import IndenterDimensions, IndenterList, load_indenters

RESIN = "Formlabs tough epoxy resin"
PRINT = "SLA print"


@dataclass(frozen=True)
class Part:
    """One part that can be made.

    builder: import string `module:function`; the function takes the dimensions and returns one
    solid, and its module's `expect` states what that solid must be.
    quantity: pieces for one sensor or one test bench.
    indenter: the dimensions of an indenter, None for a part of the sensor.
    default: exported when no part is named.
    """

    name: str
    builder: str
    material: str
    process: str
    quantity: int = 1
    indenter: IndenterDimensions | None = None
    default: bool = True


SENSOR_PARTS = (
    Part("skin-frame", "deltact_fab.cad.parts.skin_frame:build", f"{RESIN}, black", PRINT),
    Part(
        "skin",
        "deltact_fab.cad.parts.skin:build",
        "Solaris silicone, Shore 15A, clear, 1:1",
        "cast in a mold around the frame",
    ),
)


def listed(indenters: IndenterList | None = None) -> list[Part]:
    """The sensor's parts, then the indenters of the list (cad/indenters.toml by default)."""
    known = load_indenters() if indenters is None else indenters
    return [
        *SENSOR_PARTS,
        *(_indenter(entry.name, known, entry.quantity, entry.export) for entry in known.indenter),
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
        names = [*parts, *KINDS]
        raise InputError(f"part {name!r}: unknown; {did_you_mean(name, names)}")
    part = _indenter(f"{kind}{colon}{size.replace('p', '.')}", known)
    return parts.get(part.name, part)


def select(names: Iterable[str], indenters: IndenterList | None = None) -> list[Part]:
    """The named parts in the order given, each once; the default parts when none is named."""
    known = load_indenters() if indenters is None else indenters
    wanted = {part.name: part for part in (find(name, known) for name in names)}
    return list(wanted.values()) or [part for part in listed(known) if part.default]


def _indenter(name: str, known: IndenterList, quantity: int = 1, default: bool = False) -> Part:
    indenter = parse(name)
    return Part(
        f"indenter-{indenter.slug}",
        "deltact_fab.cad.parts.indenter:build",
        RESIN,
        PRINT,
        quantity,
        IndenterDimensions(indenter, known.body),
        default,
    )
