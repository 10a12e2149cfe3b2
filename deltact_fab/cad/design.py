"""What a lab edits under cad/: the sensor's dimensions and the list of indenters."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from .. import catalog
from ..errors import InputError
from ..shapes import Indenter, SensorDimensions
from ..shapes.indenter import parse


@dataclass(frozen=True)
class IndenterBody:
    """What holds the tips and their shanks: one back plate."""

    plate_mm: float = 4.0

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - read by catalog.validate

    def __post_init__(self) -> None:
        if not (math.isfinite(self.plate_mm) and self.plate_mm > 0):
            raise ValueError(f"plate_mm > 0 and finite: {self.plate_mm} fails")


@dataclass(frozen=True)
class ListedIndenter:
    """One indenter of the list; `export` puts it into an export that names no parts."""

    name: str
    quantity: int = 1
    export: bool = False

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012

    def __post_init__(self) -> None:
        if self.quantity < 1:
            raise ValueError(f"quantity >= 1: {self.quantity} fails")


@dataclass(frozen=True)
class IndenterList:
    """cad/indenters.toml."""

    body: IndenterBody = field(default_factory=IndenterBody)
    indenter: tuple[ListedIndenter, ...] = ()

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012


@dataclass(frozen=True)
class IndenterDimensions:
    """Everything an indenter's solid is made from."""

    indenter: Indenter
    body: IndenterBody

    @property
    def plate_z_mm(self) -> float:
        """Underside of the back plate above the lowest point: the free length of the tips.

        It is the shape's own number, for the protocol's checks count on it.
        """
        return self.indenter.reach_mm


def load_design(name: str = "deltact") -> SensorDimensions:
    """Dimensions of a design of the `cad` catalogue (a name or a path to a TOML file).

    Raises InputError naming file and key.
    """
    path = catalog.find("cad", name)
    return catalog.validate(SensorDimensions, catalog.read(path), str(path))


def load_indenters(name: str = "indenters") -> IndenterList:
    """The indenters a lab exports, and their body. Raises InputError naming file and key."""
    path = catalog.find("cad", name)
    listed = catalog.validate(IndenterList, catalog.read(path), str(path))
    seen: set[str] = set()
    for entry in listed.indenter:
        try:
            name = parse(entry.name).name
        except InputError as why:
            raise InputError(f"{path}: {why}") from why
        if name in seen:
            raise InputError(f"{path}: indenter {name!r}: listed twice; once is right")
        seen.add(name)
    return listed
