"""All parts by name: those of the files in parts/, and the listed indenters.

Files in parts/ are picked up automatically. Imports no CAD kernel.
"""

from __future__ import annotations

from collections.abc import Iterable

from deltact_fab.common import InputError, collect_entries, did_you_mean
from deltact_fab.sensor import INDENTER_KINDS, parse_indenter

from . import parts
from .design import IndenterList, load_indenters
from .dimensions import Design
from .part import PART_GROUPS, Part
from .parts.indenter import part as indenter_part


def design_parts(design: Design | None = None) -> list[Part]:
    """Return every part of a design (None: of any design), by group, from the face backwards.

    Raises RuntimeError if two files of parts/ define the same name.
    """
    by_name: dict[str, Part] = collect_entries(parts.__name__, "PARTS")
    return sorted(
        (part for part in by_name.values() if design is None or part.places(design)),
        key=lambda p: (PART_GROUPS.index(p.group), -p.explode_mm, p.number, p.name),
    )


def parts_of_group(group: str, design: Design | None = None) -> list[Part]:
    """Return the parts of one group, in the order of `design_parts`."""
    return [part for part in design_parts(design) if part.group == group]


def list_parts(indenters: IndenterList | None = None, design: Design | None = None) -> list[Part]:
    """Return `design_parts` and the indenters of the list (default: cad/indenters.toml)."""
    chosen = load_indenters() if indenters is None else indenters
    tips = [indenter_part(parse_indenter(e.name), chosen.body, e.quantity) for e in chosen.indenter]
    return [*design_parts(design), *tips]


def find_part(name: str, indenters: IndenterList | None = None) -> Part:
    """Return one part by name; an indenter also by its protocol name, in any size.

    `indenter-star`, `star` and `star:8` are valid. Raises InputError with the nearest known name,
    or the valid sizes.
    """
    chosen = load_indenters() if indenters is None else indenters
    by_name = {part.name: part for part in list_parts(chosen)}
    if name in by_name:
        return by_name[name]
    if name in chosen.shape:
        return indenter_part(chosen.shape[name].indenter(name), chosen.body)
    if name.partition(":")[0] not in INDENTER_KINDS:
        names = [*by_name, *PART_GROUPS, *INDENTER_KINDS, *chosen.shape]
        raise InputError(f"part {name!r}: unknown; {did_you_mean(name, names)}")
    part = indenter_part(parse_indenter(name), chosen.body)
    return by_name.get(part.name, part)


def select_parts(names: Iterable[str]) -> list[Part]:
    """Return the named parts in order, each once; every part if no name is given.

    A group's name selects all of its parts.
    """
    all_parts = list_parts()
    selected: dict[str, Part] = {}
    for name in names:
        grouped = [part for part in all_parts if part.group == name]
        for part in grouped or [find_part(name)]:
            selected[part.name] = part
    return list(selected.values()) or all_parts
