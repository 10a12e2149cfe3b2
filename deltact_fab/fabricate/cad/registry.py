"""Every part by name: those of the files in parts/, and the indenters of a list; and what each is
made from, its dimensions with their meaning and limits.

A file of parts/ is found by being there. Imports no CAD kernel.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, fields
from typing import Any

from deltact_fab.common import InputError, collect_entries, did_you_mean
from deltact_fab.sensor import INDENTER_KINDS, parse_indenter

from . import parts
from .design import IndenterDimensions, IndenterList, load_indenters
from .dimensions import Design
from .part import GROUPS, Part
from .parts.indenter import part as indenter_part


def of_design(design: Design | None = None) -> list[Part]:
    """Every part that a design has, or some design may have: by group, from the face backwards.

    Raises RuntimeError when two files of parts/ claim one name.
    """
    every: dict[str, Part] = collect_entries(parts.__name__, "PARTS")
    return sorted(
        (part for part in every.values() if design is None or part.places(design)),
        key=lambda p: (GROUPS.index(p.group), -p.explode_mm, p.number, p.name),
    )


def parts_of_group(group: str, design: Design | None = None) -> list[Part]:
    """The parts of one group as `of_design` has them, in their order."""
    return [part for part in of_design(design) if part.group == group]


def list_parts(indenters: IndenterList | None = None, design: Design | None = None) -> list[Part]:
    """Every part as `of_design` has them, and the indenters of the list (cad/indenters.toml)."""
    known = load_indenters() if indenters is None else indenters
    tips = [indenter_part(parse_indenter(e.name), known.body, e.quantity) for e in known.indenter]
    return [*of_design(design), *tips]


def find_part(name: str, indenters: IndenterList | None = None) -> Part:
    """One part by name; an indenter also by its name in a protocol, and in any size.

    `indenter-star`, `star` and `star:8` all exist. Raises InputError with the nearest known name,
    or stating the sizes that are valid.
    """
    known = load_indenters() if indenters is None else indenters
    every = {part.name: part for part in list_parts(known)}
    if name in every:
        return every[name]
    if name in known.shape:
        return indenter_part(known.shape[name].indenter(name), known.body)
    if name.partition(":")[0] not in INDENTER_KINDS:
        names = [*every, *GROUPS, *INDENTER_KINDS, *known.shape]
        raise InputError(f"part {name!r}: unknown; {did_you_mean(name, names)}")
    part = indenter_part(parse_indenter(name), known.body)
    return every.get(part.name, part)


def select_parts(names: Iterable[str]) -> list[Part]:
    """The named parts in the order given, each once; every part when none is named.

    A name of GROUPS stands for all of its parts.
    """
    every = list_parts()
    wanted: dict[str, Part] = {}
    for name in names:
        grouped = [part for part in every if part.group == name]
        for part in grouped or [find_part(name)]:
            wanted[part.name] = part
    return list(wanted.values()) or every


@dataclass(frozen=True)
class Dimension:
    """One independent value. low, high: what it accepts; None where it is no bounded number."""

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


def part_dimensions(part: Part, design: Design) -> Iterator[Dimension]:
    """Everything that the part is made from, also where a rule is broken: then one looks."""
    if part.indenter is not None:
        yield from _of_indenter(part.indenter)
        return
    unverified = design.unverified()
    for section in part.sections:
        record = getattr(design, section)
        for f in fields(record):
            key, meta = f"{section}.{f.name}", f.metadata
            about = (meta.get("description", ""), meta.get("ge"), meta.get("le"), key in unverified)
            yield Dimension(key, getattr(record, f.name), *about)


def _of_indenter(dims: IndenterDimensions) -> Iterator[Dimension]:
    shape = dims.indenter
    yield Dimension("plate_mm", dims.body.plate_mm, "back plate")
    yield Dimension("stem_diameter_mm", shape.stem_diameter_mm, "stem, for the tool holder")
    yield Dimension("stem_length_mm", shape.stem_length_mm, "stem above the plate")
    yield Dimension("reach_mm", shape.reach_mm, "free length of the tips below the plate")
    for number, tip in enumerate(shape.tips, 1):
        kind = type(tip).__name__.removesuffix("Tip").lower()
        yield Dimension(f"tip{number}", asdict(tip), kind)
