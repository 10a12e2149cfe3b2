"""The LEDs' current, the resistor's heat and the supply, each at its worst."""

from __future__ import annotations

from collections.abc import Iterator

from ..dimensions import Design
from .row import Row

CURRENT, HEAT, SUPPLY = "LED current", "LED resistor", "LED supply"
HEAT_SHARE = 0.5  # half of its rating keeps a resistor cool enough to touch
RESTS_ON = ("supply_tolerance", "strip_resistor_ohm", "led_v", "led_spread_v")


def rows(design: Design) -> Iterator[Row]:
    """Three rows, all with a high supply and a low forward voltage.

    LEDs in parallel are taken to share evenly; one LED's share may differ.
    """
    light = design.light

    def row(name: str, found: str, limit: str, passed: bool, rating: str) -> Row:
        keys = tuple(f"light.{key}" for key in (*RESTS_ON, rating))
        return Row(name, "light-holder", found, limit, passed, keys)

    at = f"{light.resistor_ohm:g} ohm, {light.supply_v:g} V + {100 * light.supply_tolerance:g} %"
    yield row(
        CURRENT,
        f"{light.chip_most_ma:.2f} mA a chip, {at}; all LEDs {light.least_ma:.2f} to "
        f"{light.most_ma:.2f} mA",
        f"<= {light.led_limit_ma:g} mA a chip, least > 0: light.resistor_ohm, light.supply_v",
        light.chip_most_ma <= light.led_limit_ma and light.least_ma > 0,
        "led_limit_ma",
    )
    most_w = HEAT_SHARE * light.resistor_rating_w
    yield row(
        HEAT,
        f"{1000 * light.resistor_most_w:.1f} mW, {at}",
        f"<= {1000 * most_w:g} mW, half of light.resistor_rating_w",
        light.resistor_most_w <= most_w,
        "resistor_rating_w",
    )
    yield row(
        SUPPLY,
        f"{light.most_ma:.2f} mA, {at}",
        f"<= {light.supply_rating_ma:g} mA: light.supply_rating_ma",
        light.most_ma <= light.supply_rating_ma,
        "supply_rating_ma",
    )
