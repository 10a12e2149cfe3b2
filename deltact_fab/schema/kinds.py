"""The kinds of files that a lab writes, with the model that reads each, and what is given out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any

from ..errors import InputError, did_you_mean


@dataclass(frozen=True)
class Kind:
    """One kind of file. model: loads the class that validates it; catalogue: as `catalog.KINDS`."""

    name: str
    catalogue: str
    about: str
    model: Callable[[], Any]


def _model(where: str) -> Any:
    """A class of this package, as "module:name", imported when it is asked for."""
    module, _, name = where.partition(":")
    return getattr(import_module(f"deltact_fab.{module}"), name)


_ROWS = (
    ("protocol", "protocols", "an indentation experiment", "protocols.plan:Protocol"),
    (
        "virtual-rig",
        "protocols/rigs",
        'a simulated bench, kind = "virtual"',
        "rig.config:VirtualConfig",
    ),
    ("grbl-rig", "protocols/rigs", 'a real bench, kind = "grbl"', "rig.config:GrblConfig"),
    ("pattern", "patterns", "a pattern sticker", "patterns.recipe:PatternRecipe"),
    ("design", "cad", "the dimensions of a sensor and its tools", "cad.dimensions:Design"),
    ("indenters", "cad", "the indenters that a lab makes", "cad.design:IndenterList"),
    ("cameras", "cad", "the cameras that a design can be made for", "cad.cameras:CameraList"),
    ("parts", "cad", "where what is bought is ordered", "cad.fabrication.bought:BoughtParts"),
)
KINDS = {
    name: Kind(name, catalogue, about, partial(_model, where))
    for name, catalogue, about, where in _ROWS
}


_OUTPUTS = (
    ("measured", "columns that `measure --out` keeps of each image", "live.rows:MeasuredRow"),
    ("fields", "arrays that `measure --out` keeps of each image", "live.rows:FieldArrays"),
)
OUTPUTS = {name: Kind(name, "", about, partial(_model, where)) for name, about, where in _OUTPUTS}
"""What the program writes: no one edits them."""


def kind_named(name: str) -> Kind:
    """Raises InputError naming the nearest kind, or all of them."""
    found = KINDS | OUTPUTS
    if name not in found:
        raise InputError(f"schema {name!r}: no such kind of file; {did_you_mean(name, found)}")
    return found[name]
