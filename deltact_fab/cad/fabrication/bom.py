"""The bill of materials, from the registry and the dimensions. Imports no CAD kernel."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields

from .. import feasibility
from ..design import IndenterList
from ..dimensions import Design
from ..parts.camera import CABLE, COMPUTER
from ..parts.light_holder import WIRE, WIRE_COLOURS
from ..registry import listed
from . import quantities
from .quantities import DEFAULT, Process

CONSUMABLES, WORKSHOP = "consumables", "workshop"
PIECES = "pcs"
JETSON_PIN_MA = 500.0  # ours, cautious: the pins share the board's supply


@dataclass(frozen=True)
class BomLine:
    """One line. item counts from 1. group: of the registry, `consumables` or `workshop`.

    quantity is what the order takes, in `unit`: pcs, g, ml, mm.
    """

    item: int
    group: str
    part: str
    material: str
    process: str
    quantity: float
    unit: str
    note: str


BomRow = tuple[str, str, str, str, float, str, str]


def lines(
    design: Design,
    sensors: int = 1,
    waste: float = 0.1,
    indenters: IndenterList | None = None,
    process: Process = DEFAULT,
) -> list[BomLine]:
    """Everything to order for a number of sensors, one mold, one test bench and the indenters.

    waste: share of silicone on top of what fills the mold. indenters: cad/indenters.toml unless
    given. Raises InputError for a count below 1, a waste that is no share, a broken rule.
    """
    quantities.checked(sensors, waste)
    feasibility.check(design)
    rows: list[BomRow] = [
        *_parts(design, sensors, indenters),
        *((CONSUMABLES, *row) for row in _silicone(design, sensors, waste, process)),
        *((CONSUMABLES, *row) for row in _electronics(design, sensors)),
        *((WORKSHOP, *row) for row in _workshop(design)),
    ]
    return [BomLine(i, *row) for i, row in enumerate(rows, 1)]


def csv_text(bom: Sequence[BomLine]) -> str:
    """The lines as CSV with a header; numbers without rounding noise."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([f.name for f in fields(BomLine)])
    for line in bom:
        writer.writerow([f"{v:.6g}" if isinstance(v, float) else v for v in astuple(line)])
    return out.getvalue()


def _parts(design: Design, sensors: int, indenters: IndenterList | None) -> Iterator[BomRow]:
    """Parts of the registry: what a sensor takes for each, tools, bench and indenters once."""
    for p in listed(indenters):
        count = p.quantity * (sensors if p.per_sensor else 1)
        yield p.group, p.name, p.material, p.process, count, PIECES, p.noted(design)


Consumable = tuple[str, str, str, float, str, str]


def _silicone(d: Design, sensors: int, waste: float, process: Process) -> Iterator[Consumable]:
    cast = sensors + 1  # the transparent base is cast with the others
    cells, fills = quantities.cavities(d), quantities.pours(d, cast)
    skins = quantities.skins_batch(d, fills * cells, waste, process)
    one = quantities.skins_batch(d, 1, waste, process)
    told = (
        f"mold filled {fills} x ({cells} cavities), {100 * waste:g} % waste; one skin takes "
        f"{one.a_g:.1f} g; 1:1"
    )
    for part, mass_g in (("A", skins.a_g), ("B", skins.b_g)):
        yield (f"Solaris part {part}", "platinum silicone, clear, 15A", "weigh", mass_g, "g", told)
    x, y = d.acrylic_half_mm
    gap_mm = 5.0  # laser kerf and clamping, in the blank
    blank = f"{2 * x + 2 * gap_mm:.0f} x {2 * y + 2 * gap_mm:.0f} mm a plate"
    yield (
        "acrylic blank", f"cast PMMA, {d.optics.acrylic_mm:g} mm, clear, both faces masked",
        "laser cut", cast, PIECES, f"{blank}; one for the transparent base",
    )  # fmt: skip
    if d.shell.ledge_drop_mm > 0:
        yield (
            "neutral-cure silicone, Shore A 30 or harder", "RTV, for acrylic", "by hand", 1,
            PIECES, f"bead of {d.shell.ledge_drop_mm:g} mm under a plate; far from the casting",
        )  # fmt: skip
    yield (
        "DOWSIL PR-1200 RTV prime coat", "primer", "wipe on",
        quantities.primer_ml(d, cast, process), "ml", f"{cast} plates, one face; flammable",
    )  # fmt: skip
    fx, fy = d.skin.film_mm(process.film_margin_mm)
    yield (
        "water transfer film", "printable", "print, soak", sensors, PIECES,
        f"{fx:g} x {fy:g} mm each; print spares on the sheet",
    )  # fmt: skip
    coat = quantities.coat_batch(d, sensors, waste, process)
    least = quantities.least_coat_batch(coat, process)
    for part, mass_g in (("A", 2 * least.a_g), ("B", 2 * least.b_g)):
        yield (
            f"Dragon Skin 10 FAST part {part}", "platinum silicone, 10A", "weigh", mass_g, "g",
            f"two layers of {process.coat_mm:g} mm; {2 * coat.a_g:.2g} g adheres, the rest is the "
            "least batch that can be weighed",
        )  # fmt: skip
    for colour, layer in (("white", "inner"), ("black", "outer")):
        yield (
            f"silicone pigment, {colour}", "for platinum silicone", "weigh", least.pigment_g, "g",
            f"{layer} layer, {100 * process.coat_pigment:g} % by weight",
        )  # fmt: skip


def _electronics(d: Design, sensors: int) -> Iterator[Consumable]:
    light = d.light
    yield (
        f"resistor {light.resistor_ohm:g} ohm", f"1 %, {light.resistor_rating_w:g} W", "solder",
        sensors, PIECES,
        f"{light.total_ma:.2f} mA in all ({light.least_ma:.2f} to {light.most_ma:.2f}) at "
        f"{light.supply_v:g} V ± {100 * light.supply_tolerance:g} % and {light.led_v:g} ± "
        f"{light.led_spread_v:g} V forward (assumed); {1000 * light.resistor_most_w:.1f} mW at "
        "most",
    )  # fmt: skip
    takes_ma = sensors * light.most_ma
    # The least usual rating that is no more than half used.
    half_a, ratings_a = 2 * takes_ma / 1000, (0.1, 0.25, 0.5, 1, 2, 3, 5, 10)
    rating_a = next((a for a in ratings_a if a >= half_a), math.ceil(half_a))
    pin = light.supply_v == 5 and takes_ma <= JETSON_PIN_MA
    yield (
        f"supply {light.supply_v:g} V DC", f"plug, {rating_a:g} A or more", "bought", 1,
        PIECES, f"the LEDs take {takes_ma:.0f} mA at most"
        + ("; or a 5 V pin of the Jetson" if pin else ""),
    )  # fmt: skip
    yield (
        f"wire {WIRE}", f"{' and '.join(WIRE_COLOURS)}, silicone", "solder",
        sensors * 2 * light.wire_mm, "mm", f"two of {light.wire_mm:g} mm",
    )  # fmt: skip
    yield (
        "black foam, soft, closed cell", "light-tight", "cut, push in", sensors, PIECES,
        f"{d.shell.cable_foam_mm:g} mm long; closes the {d.shell.cable_width_mm:g} x "
        f"{d.shell.cable_height_mm:g} mm cable notch "
        "around cable and wires; or black neutral-cure silicone, kept away from the casting",
    )  # fmt: skip
    yield (
        "camera cable", CABLE, "bought", sensors, PIECES,
        "contacts on one side as your camera's; length as your arm needs",
    )  # fmt: skip
    yield (
        COMPUTER, "", "bought", math.ceil(sensors / 2), PIECES,
        "two camera ports each",
    )  # fmt: skip


def _workshop(d: Design) -> Iterator[Consumable]:
    for name, note in (
        ("vacuum chamber and pump", "50 mbar absolute or lower"),
        ("balance", "0.1 g or finer"),
        ("nitrile gloves", "for uncured resin and for the casting; latex inhibits the cure"),
        ("safety goggles", "for uncured resin, primer, lacquer and washing"),
        ("isopropanol, 99 %", "washing prints, degreasing plates"),
        ("clear acrylic lacquer, spray", "barrier coat, if the coupon stays tacky"),
        ("adhesive tape, silicone free", "over the frames' screw holes"),
        (f"hexagon key {d.screw.row.socket_mm:g} mm", f"for {d.screw.thread}"),
        ("multimeter", "current of the LEDs"),
    ):
        yield name, "", "bought", 1, PIECES, note
