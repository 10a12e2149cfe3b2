"""Where what is bought is ordered: cad/parts.toml, a lab's own list."""

from __future__ import annotations

from dataclasses import dataclass, field

from ... import catalog

UNKNOWN = "not looked up"


@dataclass(frozen=True)
class BoughtPart:
    """One line that is bought, and where."""

    line: str
    """Name of the line in `cad bom`."""
    when: str = ""
    """Words that the line must hold, as a screw's size; none: any."""
    maker: str = UNKNOWN
    """Maker and product."""
    order_number: str = UNKNOWN
    """Number to order it by, of the maker or of the shop that is named."""
    second_source: str = UNKNOWN
    """Who else sells it."""
    sold_by: str = UNKNOWN
    """Unit in which it is sold."""
    price: str = UNKNOWN
    """Of one such unit, with its currency."""
    priced_on: str = UNKNOWN
    """The day of that price."""
    instead: str = UNKNOWN
    """What may replace it, or must not."""
    found_in: str = UNKNOWN
    """What says so."""

    __pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # noqa: RUF012

    def __str__(self) -> str:
        """Maker and number, as short as they can be said."""
        if self.maker == self.order_number:
            return self.maker
        return f"{self.maker}: {self.order_number}"


@dataclass(frozen=True)
class BoughtParts:
    """cad/parts.toml."""

    bought: tuple[BoughtPart, ...] = field(default=())
    """One `[[bought]]` table each."""

    __pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # noqa: RUF012

    def of(self, line: str, *texts: str) -> BoughtPart:
        """The first source of a line whose texts hold its words; one of marks where none is."""
        said = " ".join(texts)
        fits = (one for one in self.bought if one.line == line and one.when in said)
        return next(fits, BoughtPart(line))


def load_bought() -> BoughtParts:
    """The lab's list. Raises InputError naming file and key."""
    path = catalog.find("cad", "parts")
    return catalog.validate(BoughtParts, catalog.read(path), str(path))
