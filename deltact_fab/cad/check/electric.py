"""The light: current, heat and supply at their worst, and how evenly it falls on the face."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..dimensions import Design
from ..parts.led_strip import led_turns
from .row import Row, at_least

CURRENT, HEAT, SUPPLY, EVEN = "LED current", "LED resistor", "LED supply", "even light"
DARK = "LED current, least"
LEAST_MA = 1.0  # a camera makes up for half of the paper's circuit, 2.1 mA at its least: one stop
HEAT_SHARE = 0.5  # half of its rating keeps a resistor cool enough to touch
EVEN_SHARE = 0.6  # least over mean, as EN 12464-1 has it for a place of reading
RESTS_ON = ("supply_tolerance", "strip_resistor_ohm", "led_v", "led_spread_v")


def rows(design: Design) -> Iterator[Row]:
    """Most and least of what the supply gives, and the evenness.

    LEDs in parallel are taken to share evenly; one LED's share may differ.
    """
    light = design.light
    at = f"{light.resistor_ohm:g} ohm, {light.supply_v:g} V ± {100 * light.supply_tolerance:g} %"
    for name, found, limit, margin, rating in (
        (CURRENT, f"{light.chip_most_ma:.2f} mA a chip", f"<= {light.led_limit_ma:g} mA a chip",
         light.led_limit_ma - light.chip_most_ma, "led_limit_ma"),
        (DARK, f"{light.least_ma:.2f} mA for all LEDs", f">= {LEAST_MA:g} mA",
         light.least_ma - LEAST_MA, "led_v"),
        (HEAT, f"{1000 * light.resistor_most_w:.1f} mW",
         f"<= {1000 * HEAT_SHARE * light.resistor_rating_w:g} mW, half of light.resistor_rating_w",
         HEAT_SHARE * light.resistor_rating_w - light.resistor_most_w, "resistor_rating_w"),
        (SUPPLY, f"{light.most_ma:.2f} mA", f"<= {light.supply_rating_ma:g} mA",
         light.supply_rating_ma - light.most_ma, "supply_rating_ma"),
    ):  # fmt: skip
        keys = tuple(f"light.{key}" for key in (*RESTS_ON, rating))
        yield at_least(name, "light-holder", f"{found}, {at}", limit, margin, keys)
    share = evenness(design)
    yield at_least(
        EVEN,
        "light-holder, skin",
        f"least {share:.2f} of the mean over the view, {light.led_count} LEDs {light.pitch_mm:.1f} "
        "mm apart",
        f">= {EVEN_SHARE:g}",
        share - EVEN_SHARE,
    )


def evenness(design: Design) -> float:
    """Least over mean illuminance of the face in view.

    Each LED counts as a Lambertian source in the ring's front, in the middle of the channel, that
    looks at the face: h^2 / d^4. Refraction, walls and what the diffuser spreads along the ring
    are left out: they make it more even.
    """
    x, y = np.meshgrid(*(np.linspace(-side / 2, side / 2, 31) for side in design.optics.view_mm))
    light = lit(design, x, y)
    return float(light.min() / light.mean())


def lit(
    design: Design, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64], dark: int | None = None
) -> NDArray[np.float64]:
    """Illuminance at points of the face, as `evenness` has it; dark: an LED that gives none."""
    r = (design.strip_radius_mm + design.channel_inner_mm) / 2
    light = np.zeros_like(x_mm)
    for led, turn in enumerate(led_turns(design)):
        away = (x_mm - r * np.cos(turn)) ** 2 + (y_mm - r * np.sin(turn)) ** 2
        if led != dark:
            light += design.z_light_mm**2 / (away + design.z_light_mm**2) ** 2
    return light
