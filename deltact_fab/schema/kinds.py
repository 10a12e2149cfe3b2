"""The kinds of files that a lab writes, and the model that reads each of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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


def _of(module: str, name: str) -> Callable[[], Any]:
    """The class of a module of this package, imported when it is asked for."""
    return lambda: getattr(import_module(f"deltact_fab.{module}"), name)


KINDS = {
    kind.name: kind
    for kind in (
        Kind(
            "protocol", "protocols", "an indentation experiment", _of("protocols.plan", "Protocol")
        ),
        Kind(
            "virtual-rig",
            "protocols/rigs",
            'a simulated bench, kind = "virtual"',
            _of("rig.config", "VirtualConfig"),
        ),
        Kind(
            "grbl-rig",
            "protocols/rigs",
            'a real bench, kind = "grbl"',
            _of("rig.config", "GrblConfig"),
        ),
        Kind("pattern", "patterns", "a pattern sticker", _of("patterns.recipe", "PatternRecipe")),
        Kind(
            "design",
            "cad",
            "the dimensions of a sensor and its tools",
            _of("cad.dimensions", "Design"),
        ),
        Kind(
            "indenters", "cad", "the indenters that a lab makes", _of("cad.design", "IndenterList")
        ),
    )
}


def kind_named(name: str) -> Kind:
    """Raises InputError naming the nearest kind, or all of them."""
    if name not in KINDS:
        raise InputError(f"schema {name!r}: no such kind of file; {did_you_mean(name, KINDS)}")
    return KINDS[name]
