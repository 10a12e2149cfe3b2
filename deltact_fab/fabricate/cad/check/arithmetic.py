"""Checks by arithmetic on the dimensions, without solids, so that they run whatever else fails.

Inequalities, fits at the machines' tolerances, the light, the plate under a press.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Check, graded

from ..dimensions import Design
from ..feasibility import rules as all_rules
from ..part import PRINT_PROCESS
from ..parts.light_holder import led_turns, plate_bending_room
from ..registry import design_parts
from ..rule import first_of, statement
from ..standards import CHEESE_STOCK_MM, SHEET_STOCK_MM
from ..stiffness import bend, plate_of, press_plate
from .row import margin_check

MIN_LED_MA = 1.0  # by hand: one stop below the paper's circuit (2.1 mA); less is underexposed
HEAT_SHARE = 0.5  # by hand, of a resistor's rating: more is too hot to touch
EVEN_LIGHT_SHARE = 0.6  # minimum over mean (EN 12464-1, reading)
CIRCUIT_KEYS = ("supply_tolerance", "strip_w_per_m", "led_v", "led_spread_v")
GEL_SPREAD_KEY = "plate.spread_mm"
PLATE_KEYS = (GEL_SPREAD_KEY, "plate.youngs_modulus_mpa", "plate.bead_modulus_mpa")


def inequalities(design: Design) -> Iterator[Check]:
    """Check each part's rules: number met and tightest margin, or those that fail."""
    groups: dict[str, list[Check]] = {}
    for rule in all_rules(design):
        groups.setdefault(rule.subject, []).append(rule)
    for part, rules in groups.items():
        broken = [statement(rule) for rule in rules if rule.failed]
        tightest = statement(min(rules, key=_margin_share))
        value = f"{len(rules)}/{len(rules)} constraints met; tightest: {tightest}"
        if broken:
            value = f"{len(broken)}/{len(rules)} constraints fail: {first_of(broken, '; ')}"
        keys = tuple(dict.fromkeys(key for rule in rules for key in rule.basis))
        margin = min((r.margin or 0.0) - (1e-6 if r.failed else 0.0) for r in rules)
        yield Check(f"inequalities.{part}", "inequalities", part, value, "all met",
                    graded(not broken), keys, margin=margin)  # fmt: skip


def _margin_share(rule: Check) -> float:
    """Return the margin between both sides as a share of the larger one."""
    value, limit = float(rule.value), float(rule.limit)
    return (limit - value) / max(abs(value), abs(limit), 1e-9)


def fits(design: Design) -> Iterator[Check]:
    """Check each mating pair: minimum and maximum play at worst-case lengths."""
    for part in design_parts(design):
        for fit in part.fits(design):
            yield replace(fit.check(), id=f"{part.name}.{fit.id}")


def platform(design: Design) -> Iterator[Check]:
    """Check the printed part with the least margin on the platform, straight or turned by 90°."""
    printer = design.resin_printer
    room = [*sorted((printer.bed_x_mm, printer.bed_y_mm), reverse=True), printer.bed_z_mm]
    sides = {}
    for part in design_parts(design):
        if part.process == PRINT_PROCESS:
            low, high = part.box(part.source(design))
            x, y, z = part.pose.size_mm(low, high)
            sides[part.name] = [max(x, y), min(x, y), z]
    margins = {
        name: min(r - s for r, s in zip(room, size, strict=True)) for name, size in sides.items()
    }
    keys = tuple(f"resin_printer.bed_{axis}_mm" for axis in "xyz")
    limit = f"<= {_size_text(room)} ({', '.join(keys)})"
    tight = [n for n in margins if margins[n] < 0] or [min(margins, key=margins.__getitem__)]
    for name in tight:
        status, id = graded(margins[name] >= 0), f"fits-printer.{name}"
        yield Check(id, "fits the printer", name, _size_text(sides[name]), limit, status, keys)


def stock(design: Design) -> Iterator[Check]:
    """Check the lengths of screws and the sheet's thickness: they are sold."""
    screw, holder = design.screw, design.holder
    for part, key, value_mm, stock_mm, exempt in (
        ("screw", "screw.length_mm", screw.length_mm, screw.row.stock_mm, screw.cut),
        ("camera-screw", "holder.screw_length_mm", holder.screw_length_mm, CHEESE_STOCK_MM,
         not design.camera_screw_centres_mm),
        ("acrylic", "optics.acrylic_mm", design.optics.acrylic_mm, SHEET_STOCK_MM, False),
    ):  # fmt: skip
        passed = exempt or value_mm in stock_mm
        limit = f"sold: {', '.join(f'{mm:g}' for mm in stock_mm)} mm"
        remedy = "" if passed else f"{key}: {min(stock_mm, key=lambda mm: abs(mm - value_mm)):g}"
        value, status = f"{value_mm:g} mm", graded(passed)
        yield Check(f"sold.{part}", "sold", part, value, limit, status, remedy=remedy)


def _size_text(sides_mm: list[float]) -> str:
    return " x ".join(f"{side:.4g}" for side in sides_mm) + " mm"


def light(design: Design) -> Iterator[Check]:
    """Check maximum and minimum LED current, dissipation, supply and uniformity.

    Cuts in parallel are assumed to share the current evenly.
    """
    light = design.light
    supply = f"{light.supply_v:g} V ± {100 * light.supply_tolerance:g} %"
    circuit = f"{light.resistor_ohm:g} ohm, {supply}"
    lit_ma = light.leds_per_cut * light.least_ma
    for id, name, value, limit, margin, rating in (
        ("led-current", "LED current", f"{light.cut_most_ma:.2f} mA per LED",
         f"<= {light.cut_rated_ma:.3g} mA, the strip's rating",
         light.cut_rated_ma - light.cut_most_ma, "strip_w_per_m"),
        ("led-current-least", "LED current, least", f"{lit_ma:.2f} mA summed over the LEDs",
         f">= {MIN_LED_MA:g} mA", lit_ma - MIN_LED_MA, "led_v"),
        ("led-resistor", "LED resistor", f"{1000 * light.resistor_most_w:.1f} mW",
         f"<= {1000 * HEAT_SHARE * light.resistor_rating_w:g} mW, half of light.resistor_rating_w",
         HEAT_SHARE * light.resistor_rating_w - light.resistor_most_w, "resistor_rating_w"),
        ("led-supply", "LED supply", f"{light.most_ma:.2f} mA", f"<= {light.supply_rating_ma:g} mA",
         light.supply_rating_ma - light.most_ma, "supply_rating_ma"),
    ):  # fmt: skip
        keys = tuple(f"light.{key}" for key in dict.fromkeys((*CIRCUIT_KEYS, rating)))
        yield margin_check(id, name, "light-holder", f"{value}, {circuit}", limit, margin, keys)
    share = evenness(design)
    value = f"minimum/mean {share:.2f} over the view, {light.led_count} LEDs "
    value += f"in {light.cuts} cuts"
    limit, margin = f">= {EVEN_LIGHT_SHARE:g}", share - EVEN_LIGHT_SHARE
    yield margin_check("even-light", "even light", "light-holder, skin", value, limit, margin)


def evenness(design: Design) -> float:
    """Return minimum over mean illuminance of the face in view.

    Each LED counts as a Lambertian source in the ring's front, in the middle of the channel, that
    looks at the face: h^2 / d^4. Not modelled: refraction, walls and the diffuser's spread along
    the ring, all of which make it more uniform.
    """
    x, y = np.meshgrid(*(np.linspace(-side / 2, side / 2, 31) for side in design.optics.view_mm))
    light = illuminance(design, x, y)
    return float(light.min() / light.mean())


def illuminance(
    design: Design, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64], dark: int | None = None
) -> NDArray[np.float64]:
    """Illuminance at points of the face by the model of `evenness`; dark: index of a dead cut."""
    r = (design.strip_radius_mm + design.channel_inner_mm) / 2
    light = np.zeros_like(x_mm)
    for led, turn in enumerate(led_turns(design)):  # a dead LED darkens its cut
        distance2 = (x_mm - r * np.cos(turn)) ** 2 + (y_mm - r * np.sin(turn)) ** 2
        if led // design.light.leds_per_cut != dark:
            light += design.z_light_mm**2 / (distance2 + design.z_light_mm**2) ** 2
    return light


def bending(design: Design) -> Iterator[Check]:
    """Check the plate: deflection, contact with the light holder, stress, loaded area.

    The stage's depth includes the plate's deflection; a light holder that carries a press passes
    it on to the camera's board. The gel spreads no press beyond its own face.
    """
    plate, force_n = design.plate, design.plate.force_n
    response = press_plate(design, force_n)
    bare = replace(plate_of(design), bead_mm=0.0)
    of_plate_mm = force_n * bend(bare, plate.spread_mm).deflection_mm
    bead_mm = response.deflection_mm - of_plate_mm
    limit_mm = plate.deflection_share * plate.depth_mm
    room_mm = plate_bending_room(design).range_mm[0]
    face_mm = min(design.skin.width_mm, design.skin.length_mm)

    over_mm = response.over_ring_mm
    rests_n = force_n * max(room_mm, 0.0) / over_mm if over_mm > 0 else math.inf

    def row(id: str, name: str, passed: bool, value: str, limit: str, *keys: str) -> Check:
        return Check(id, name, "acrylic", value, limit, graded(passed), keys)

    text = (
        f"{response.deflection_mm:.3f} mm under {force_n:g} N, {bead_mm:.3f} mm from the bead; "
        f"{100 * response.deflection_mm / plate.depth_mm:.1f} % of {plate.depth_mm:g} mm depth"
    )
    limit = f"<= {limit_mm:.3g} mm (plate.deflection_share of plate.depth_mm)"
    passed = response.deflection_mm <= limit_mm
    yield row("plate-deflection", "plate deflection", passed, text, limit, *PLATE_KEYS)
    text = (
        f"deflects {response.over_ring_mm:.3f} mm over the ring under {force_n:g} N, contact from "
        f"{rests_n:.0f} N"
    )
    limit, passed = f"<= {room_mm:.3g} mm, minimum play (light.axial_fit_mm)", over_mm <= room_mm
    yield row("plate-clear-of-light", "plate clear of the light", passed, text, limit, *PLATE_KEYS)
    most_mpa = plate.stress_limit_mpa
    text = (
        f"{response.stress_mpa:.1f} MPa under {force_n:g} N, limit reached at "
        f"{force_n * most_mpa / response.stress_mpa:.0f} N"
    )
    limit, keys = f"<= {most_mpa:g} MPa (plate.stress_limit_mpa)", ("plate.stress_limit_mpa",)
    passed = response.stress_mpa <= most_mpa
    yield row("plate-stress", "plate stress", passed, text, limit, GEL_SPREAD_KEY, *keys)
    text = f"{force_n:g} N on a disc of {plate.spread_mm:g} mm diameter"
    limit = f"<= {face_mm:g} mm, the face's shorter side (plate.spread_mm)"
    yield row("plate-load", "plate load", plate.spread_mm <= face_mm, text, limit, GEL_SPREAD_KEY)
