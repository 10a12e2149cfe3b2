"""The kinds of files that a lab writes, and the model that reads each of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ..errors import InputError, did_you_mean


@dataclass(frozen=True)
class Kind:
    """One kind of file. model: loads the class that validates it; catalogue: as `catalog.KINDS`."""

    name: str
    catalogue: str
    about: str
    model: Callable[[], Any]


def _protocol() -> Any:
    from ..protocols.plan import Protocol

    return Protocol


def _virtual() -> Any:
    from ..rig.config import VirtualConfig

    return VirtualConfig


def _grbl() -> Any:
    from ..rig.config import GrblConfig

    return GrblConfig


def _pattern() -> Any:
    from ..patterns.recipe import PatternRecipe

    return PatternRecipe


def _design() -> Any:
    from ..cad.dimensions import Design

    return Design


def _indenters() -> Any:
    from ..cad.design import IndenterList

    return IndenterList


KINDS = {
    kind.name: kind
    for kind in (
        Kind("protocol", "protocols", "an indentation experiment", _protocol),
        Kind("virtual-rig", "protocols/rigs", 'a simulated bench, kind = "virtual"', _virtual),
        Kind("grbl-rig", "protocols/rigs", 'a real bench, kind = "grbl"', _grbl),
        Kind("pattern", "patterns", "a pattern sticker", _pattern),
        Kind("design", "cad", "the dimensions of a sensor and its tools", _design),
        Kind("indenters", "cad", "the indenters that a lab makes", _indenters),
    )
}


def kind_named(name: str) -> Kind:
    """Raises InputError naming the nearest kind, or all of them."""
    if name not in KINDS:
        raise InputError(f"schema {name!r}: no such kind of file; {did_you_mean(name, KINDS)}")
    return KINDS[name]
