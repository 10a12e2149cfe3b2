"""The kinds of files that a lab writes, with the model that reads each, and what is given out."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

from ..errors import InputError, did_you_mean


@dataclass(frozen=True)
class Kind:
    """One kind of file. where: the class that validates it; catalogue: as `catalog.KINDS`."""

    name: str
    catalogue: str
    about: str
    where: str

    def model(self) -> Any:
        """The class, "module:name" of this package, imported when it is asked for."""
        module, _, name = self.where.partition(":")
        return getattr(import_module(f"deltact_fab.{module}"), name)


_RIGS = "protocols/rigs"
KINDS = {
    kind.name: kind
    for kind in (
        Kind("protocol", "protocols", "an indentation experiment", "protocols.plan:Protocol"),
        Kind("virtual-rig", _RIGS, 'a simulated bench, kind = "virtual"',
             "rig.config:VirtualConfig"),
        Kind("grbl-rig", _RIGS, 'a real bench, kind = "grbl"', "rig.config:GrblConfig"),
        Kind("pattern", "patterns", "a pattern sticker", "patterns.recipe:PatternRecipe"),
        Kind("design", "cad", "the dimensions of a sensor and its tools", "cad.dimensions:Design"),
        Kind("indenters", "cad", "the indenters that a lab makes", "cad.design:IndenterList"),
        Kind("cameras", "cad", "the cameras that a design can be made for",
             "cad.design:CameraList"),
        Kind("parts", "cad", "where what is bought is ordered",
             "cad.fabrication.bom:BoughtParts"),
    )
}  # fmt: skip
OUTPUTS = {
    kind.name: kind
    for kind in (
        Kind("measured", "", "columns that `measure --out` keeps of each image",
             "live.formatting:MeasuredRow"),
        Kind("fields", "", "arrays that `measure --out` keeps of each image",
             "live.formatting:FieldArrays"),
    )
}  # fmt: skip
"""What the program writes: no one edits them."""


def kind_named(name: str) -> Kind:
    """Raises InputError naming the nearest kind, or all of them."""
    found = KINDS | OUTPUTS
    if name not in found:
        raise InputError(f"schema {name!r}: no such kind of file; {did_you_mean(name, found)}")
    return found[name]
