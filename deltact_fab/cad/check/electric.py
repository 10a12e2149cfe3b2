"""The LEDs' current at its worst, against what a chip may carry."""

from __future__ import annotations

from collections.abc import Iterator

from ..dimensions import Design
from ..making.fabrication import DEFAULT, current_range_ma
from .row import Row

NAME = "LED current"
CHIP_MA = 20.0  # a chip of a 5050, as their data sheets rate it
SUPPLY_SHARE = 0.05  # a 5 V supply may be so much off (USB 2.0: 4.75 to 5.25 V)


def worst_ma(design: Design) -> float:
    """Most current of a chip: high supply, low forward voltage, without the strip's own resistor.

    I = (1.05 supply - lowest forward voltage) / resistor / LEDs / chips. LEDs in parallel are taken
    to share evenly; one LED's share may differ.
    """
    light = design.light
    high_ma = current_range_ma(light)[1]
    high_ma += SUPPLY_SHARE * light.supply_v / light.resistor_ohm * 1000
    return high_ma / light.led_count / DEFAULT.led_chips


def rows(design: Design) -> Iterator[Row]:
    """One row: the current of a chip at its worst."""
    found = worst_ma(design)
    light = design.light
    limit = f"<= {CHIP_MA:g} mA: light.resistor_ohm, light.supply_v"
    text = f"{found:.2f} mA a chip, {light.resistor_ohm:g} ohm at {light.supply_v:g} V + 5 %"
    yield Row(NAME, "light-holder", text, limit, 0 < found <= CHIP_MA)
