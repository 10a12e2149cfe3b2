"""The bill of materials, from the registry and the dimensions. Imports no CAD kernel.

Consumables and tools are in bom.toml, whose figures are computed here. Sources of bought parts are
in cad/parts.toml, a lab's own list.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

from deltact_fab.common import InputError, find_file, read_toml, validate

from .. import feasibility
from ..dimensions import Design
from ..part import LASER_CUT, MACHINED_PROCESS, PRINT_PROCESS
from ..parts.camera import HOST_COMPUTER
from ..parts.light_holder import WIRE_COLOURS, WIRE_SIZE
from ..registry import list_parts
from . import quantities
from .quantities import DEFAULT_FIGURES, WASTE_SHARE, fill_tables

PIECE_UNIT = "pcs"
MADE_PROCESSES = (PRINT_PROCESS, LASER_CUT, MACHINED_PROCESS, "cast in the mold")  # need no source
TABLE_GROUPS = ("consumables", "workshop")  # of bom.toml, whose materials give the size
UNKNOWN_SOURCE = "not looked up"
JETSON_PIN_MA = 500.0  # by hand, cautious: the pins share the board's supply; more may reset it


@dataclass(frozen=True)
class BoughtPart:
    """Source of one bought line."""

    line: str
    """Name of the line in `cad bom`."""
    when: str = ""
    """Text that the line must contain, such as a screw's size; empty: any."""
    maker: str = UNKNOWN_SOURCE
    """Maker and product."""
    order_number: str = UNKNOWN_SOURCE
    """Order number of the maker or the named shop."""
    second_source: str = UNKNOWN_SOURCE
    """Alternative supplier."""
    sold_by: str = UNKNOWN_SOURCE
    """Unit in which it is sold."""
    price: str = UNKNOWN_SOURCE
    """Price of one such unit, with its currency."""
    priced_on: str = UNKNOWN_SOURCE
    """Date of that price."""
    instead: str = UNKNOWN_SOURCE
    """Substitutes, allowed or not."""
    found_in: str = UNKNOWN_SOURCE
    """Reference for these entries."""
    search: str = ""
    """Words to search a shop for; empty: name and specification of the line."""

    __pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # noqa: RUF012

    def __str__(self) -> str:
        """Maker and order number, or else the words to search for."""
        if self.orderable:
            has_maker = self.maker != self.order_number and not self.maker.startswith("not ")
            return f"{self.maker}: {self.order_number}" if has_maker else self.order_number
        maker = "" if self.maker.startswith("not ") else f"{self.maker}; "
        return f"{maker}search: {self.search}"

    @property
    def orderable(self) -> bool:
        """True if it has an order number."""
        return not self.order_number.startswith("not ")


@dataclass(frozen=True)
class BoughtParts:
    """cad/parts.toml."""

    bought: tuple[BoughtPart, ...] = field(default=())
    """One `[[bought]]` table each."""

    __pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # noqa: RUF012

    def find_source(self, line: str, *texts: str) -> BoughtPart:
        """Return the first source whose `when` the texts contain; an unknown one if none does."""
        text = " ".join(texts)
        fits = (source for source in self.bought if source.line == line and source.when in text)
        return next(fits, BoughtPart(line))


def load_bought() -> BoughtParts:
    """Load the lab's list. Raises InputError naming file and key."""
    path = find_file("cad", "parts")
    return validate(BoughtParts, read_toml(path), str(path))


@dataclass(frozen=True)
class BomLine:
    """One line. item counts from 1. group: of the registry, `consumables` or `workshop`.

    material: of a bought line, what to ask a shop for. quantity: to order, with spares, in `unit`:
    pcs, g, ml, mm. source: of a bought line; None for a made one.
    """

    item: int
    group: str
    part: str
    material: str
    process: str
    quantity: float
    unit: str
    note: str
    source: BoughtPart | None = None


class BillOfMaterials(list[BomLine]):
    """The lines of an order, in the order of their items."""

    def headed(self, verdict: str) -> BillOfMaterials:
        """Return the lines below one with the verdict of the design's checks, item 0."""
        head = BomLine(0, "verdict", "cad check", "", "", 0, "", verdict)
        return BillOfMaterials([head, *self])

    def csv(self) -> str:
        """The lines as CSV with a header; numbers without rounding noise."""
        import pandas as pd

        ordered = [f.name for f in fields(BoughtPart) if f.name not in ("line", "when")]
        rows = []
        for line in self:
            row = asdict(line)
            source = row.pop("source") or {}
            rows.append(row | {name: source.get(name) for name in ordered})
        return pd.DataFrame(rows).to_csv(index=False, float_format="%.6g", lineterminator="\n")


def bom_lines(design: Design, sensors: int = 1) -> BillOfMaterials:
    """Everything to order for a number of sensors, one mold, one test bench and the indenters.

    Raises InputError for a count below 1 and for a broken rule.
    """
    if sensors < 1:
        raise InputError(f"sensors {sensors}: expected 1 or more")
    feasibility.check_feasible(design)
    # From the registry: parts of the sensor per sensor; tools, bench and indenters once.
    rows: list[tuple[Any, ...]] = [
        (p.group, p.name, p.material, p.process,
         p.quantity * (sensors if p.per_sensor else 1) + p.spares, PIECE_UNIT,
         _with_spares(p.note_text(design), p.spares))
        for p in list_parts(design=design)
    ]  # fmt: skip
    figures = _figures(design, sensors)
    defaults = {"material": "", "process": "bought", "unit": PIECE_UNIT, "quantity": "one"}
    for group, bought in fill_tables("bom", d=design, p=DEFAULT_FIGURES, f=figures).items():
        for row in bought:
            item = {**defaults, **row}
            if figures[item.get("needs", "one")]:
                spares = int(item.get("spares", 0))
                count = figures[item["quantity"]] + spares
                about = (item["part"], item["material"], item["process"], count, item["unit"])
                rows.append((group, *about, _with_spares(item["note"], spares)))
    sources = load_bought()
    return BillOfMaterials(
        line if line.process in MADE_PROCESSES else replace(line, source=_source(line, sources))
        for line in (BomLine(i, *row) for i, row in enumerate(rows, 1))
    )


def _with_spares(note: str, spares: int) -> str:
    return "; ".join(filter(None, (note, f"{spares} of them spare" if spares else "")))


def _source(line: BomLine, sources: BoughtParts) -> BoughtPart:
    source = sources.find_source(line.part, line.material, line.note)
    # A part of the registry is named by us, its size stands in the note.
    size = line.note.partition(";")[0]
    texts = (line.part, line.material) if line.group in TABLE_GROUPS else (line.material, size)
    words = ", ".join(filter(None, texts))
    return replace(source, search=source.search or words)


def _figures(d: Design, sensors: int) -> dict[str, Any]:
    light = d.light
    cast = sensors + 1  # the transparent base is cast with the others
    cells, fills = quantities.cavities(d), quantities.pours(d, cast)
    coat = quantities.coat_batch(d, sensors)
    smallest_batch = quantities.least_coat_batch(coat)
    gap_mm = 5.0  # laser kerf and clamping, in the blank
    takes_ma = sensors * light.most_ma
    # The smallest common rating, at most half used.
    half_a, ratings_a = 2 * takes_ma / 1000, (0.1, 0.25, 0.5, 1, 2, 3, 5, 10)
    pin = light.supply_v == 5 and takes_ma <= JETSON_PIN_MA
    return {
        "one": 1,
        "sensors": sensors,
        "cast": cast,
        "cells": cells,
        "fills": fills,
        "waste": 100 * WASTE_SHARE,
        "skins_half_g": quantities.skins_batch(d, fills * cells).a_g,
        "one_half_g": quantities.skins_batch(d, 1).a_g,
        "blank_mm": [2 * half_mm + 2 * gap_mm for half_mm in d.acrylic_half_mm],
        "bead_mm": d.shell.ledge_drop_mm,
        "primer_ml": quantities.primer_ml(d, cast),
        "film_mm": d.skin.film_mm(DEFAULT_FIGURES.film_margin_mm),
        "coats_half_g": 2 * smallest_batch.a_g,
        "adheres_g": 2 * coat.a_g,
        "pigment_g": smallest_batch.pigment_g,
        "pigment": 100 * DEFAULT_FIGURES.coat_pigment,
        "supply_off": 100 * light.supply_tolerance,
        "resistor_mw": 1000 * light.resistor_most_w,
        "rating_a": next((a for a in ratings_a if a >= half_a), math.ceil(half_a)),
        "takes_ma": takes_ma,
        **_flange_figures(d, sensors),
        "or_pin": "; or a 5 V pin of the Jetson" if pin else "",
        "wire": WIRE_SIZE,
        "camera_screws": len(d.camera_screw_centres_mm),
        "pilot_mm": d.screw.row.pilot_mm,
        "colours": " and ".join(WIRE_COLOURS),
        "wire_mm": sensors * 2 * (light.wire_mm + (light.cuts - 1) * d.cut_step_mm),
        "computer": HOST_COMPUTER,
        "computers": math.ceil(sensors / 2),
    }


def _flange_figures(d: Design, sensors: int) -> dict[str, float]:
    """Count screws and pins of flanges with a pattern of holes; grip in the robot."""
    mount = d.mount
    flanges = sensors * (mount.kind == "flange")
    return {
        "flange_screws": flanges * len(mount.pattern.centres_mm),
        "flange_pins": flanges * (mount.pattern.pin_mm > 0),
        "flange_grip_mm": mount.flange_screw_mm - mount.height_mm - mount.thread.washer_height_mm,
    }
