"""Quantities for fabrication: silicone batches, coats, cure, light; and contradictions and gaps of
the paper with the choices made. No CAD kernel.

Figures that are not part of a design are in quantities.toml, each with its source; the texts about
the paper in paper_gaps.toml.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import asdict, dataclass, replace
from types import SimpleNamespace
from typing import Any

from deltact_fab.common import InputError
from deltact_fab.paths import asset
from deltact_fab.sensor import SkinDimensions

from ..dimensions import Design
from ..parts.screw import stock_note
from ..sensor_sections import LightDimensions
from ..standards import CAP_SCREWS, next_e24
from ..stiffness import press_plate

_BY_KEY = tomllib.loads(asset("quantities.toml").read_text(encoding="utf-8"))
_BY_KEY["film_margin_mm"]["value"] = SkinDimensions.film_margin_mm
FABRICATION_FIGURES: list[dict[str, Any]] = [{"key": key, **row} for key, row in _BY_KEY.items()]
"""Chemical and electrical figures: key, value, unit, meaning, basis."""
DEFAULT_FIGURES = SimpleNamespace(**{row["key"]: row["value"] for row in FABRICATION_FIGURES})
"""The values by key."""
WASTE_SHARE = 0.1
"""Silicone added for losses in cup and on spatula; by hand: less may not fill the mold."""
# From the paper.
PAPER_PATTERN_MM = 35.0
PAPER_PLATE_MM = 2.0
PAPER_PRESS_MM = PAPER_SHEAR_MM = 10.0
PAPER_STRIP_MM = 10.0
PAPER_SUPPLY_V, PAPER_RESISTOR_OHM = 5.0, 750.0


@dataclass(frozen=True)
class Batch:
    """One mixture of two parts, 1:1 by weight. pigment_g is 0 for clear silicone."""

    volume_cm3: float
    a_g: float
    b_g: float
    pigment_g: float = 0.0

    @property
    def total_g(self) -> float:
        """Mass in the cup."""
        return self.a_g + self.b_g + self.pigment_g


def cavities(design: Design) -> int:
    """Number of skins per mold = columns x rows."""
    return design.mold.columns * design.mold.rows


def pours(design: Design, sensors: int) -> int:
    """Number of castings for that many sensors; the last one may be partly filled."""
    return math.ceil(sensors / cavities(design))


def skins_batch(design: Design, skins: int) -> Batch:
    """Return the batch of Solaris for a number of skins.

    The paper gives 1:1 without saying by weight or volume: both parts are assumed equally dense, so
    that equal masses are equal volumes.
    """
    volume_cm3 = skins * design.skin_volume_mm3 / 1000 * (1 + WASTE_SHARE)
    half_g = volume_cm3 * DEFAULT_FIGURES.density_g_cm3 / 2
    return Batch(volume_cm3, half_g, half_g)


def coat_batch(design: Design, sensors: int, waste: float = WASTE_SHARE) -> Batch:
    """Return the batch of Dragon Skin 10 FAST for one layer on that many sensors, plus waste.

    Covers the face and the protruding sides; fillets count as sharp edges.
    """
    skin = design.skin
    sides_mm2 = 2 * (skin.width_mm + skin.length_mm) * skin.protrusion_mm
    coated_mm2 = skin.width_mm * skin.length_mm + sides_mm2
    volume_cm3 = sensors * coated_mm2 * DEFAULT_FIGURES.coat_mm / 1000 * (1 + waste)
    half_g = volume_cm3 * DEFAULT_FIGURES.coat_density_g_cm3 / 2
    return Batch(volume_cm3, half_g, half_g, 2 * half_g * DEFAULT_FIGURES.coat_pigment)


def least_coat_batch(batch: Batch) -> Batch:
    """Return the same mixture, scaled up to the smallest weighable batch."""
    scale = max(1.0, DEFAULT_FIGURES.coat_batch_g / (batch.a_g + batch.b_g))
    return Batch(*(scale * v for v in asdict(batch).values()))


def primer_ml(design: Design, sensors: int) -> float:
    """Volume of primer for one face of that many acrylic plates."""
    x, y = design.acrylic_half_mm
    return sensors * 4 * x * y / 100 * DEFAULT_FIGURES.primer_ml_per_cm2


def shrinkage_mm(design: Design) -> float:
    """Thermal shrinkage of the skin's thickness from warm cure to room temperature."""
    cooled = DEFAULT_FIGURES.cure_warm_c - DEFAULT_FIGURES.cure_room_c
    return design.skin.thickness_mm * DEFAULT_FIGURES.expansion_per_k * cooled


# Light.


def resistor_for_ohm(total_ma: float, light: LightDimensions) -> tuple[float, float]:
    """Return the resistor for this total current, and the next E24 value at or above it.

    0 if the strip's own resistors already limit the current. Raises InputError if the supply is
    below the LEDs' voltage.
    """
    room_v = light.supply_v - light.string_v
    if not (room_v > 0 and total_ma > 0):
        raise InputError(
            f"expected light.supply_v > {light.string_v:g} V, light.leds_per_cut x light.led_v, "
            f"and a current > 0 "
            f"(got {light.supply_v:g} V and {total_ma:g} mA)"
        )
    exact = max(room_v / total_ma * 1000 - light.strip_resistor_ohm / light.cuts, 0.0)
    return exact, next_e24(exact)


# The paper's gaps.


def gaps(design: Design) -> list[dict[str, str]]:
    """Return contradictions and gaps of the paper, with the figures of this design.

    Keys: said: the paper; found: the problem; chosen: this design's solution.
    """
    return fill_tables("paper_gaps", d=design, f=_figures(design))["gap"]


def fill_tables(file: str, **values: Any) -> dict[str, list[dict[str, str]]]:
    """Return the tables of an asset TOML file with the values filled into their texts."""
    text = asset(f"{file}.toml").read_text(encoding="utf-8")
    return {
        name: [{key: entry.format(**values) for key, entry in row.items()} for row in rows]
        for name, rows in tomllib.loads(text).items()
    }


def _figures(d: Design) -> dict[str, Any]:
    under_mm = d.cover.floor_mm - d.screw.row.head_height_mm
    room_mm, strip = d.z_joint_mm - d.z_board_front_mm, PAPER_STRIP_MM
    lens = [key for key in d.unverified() if key.startswith("camera.")]
    side_mm = min(d.skin.width_mm, d.skin.length_mm)
    response = press_plate(d, d.plate.force_n)
    # The paper's plate, its x edges free.
    shell, optics = replace(d.shell, ledge_x_mm=0.0), replace(d.optics, acrylic_mm=PAPER_PLATE_MM)
    thin = press_plate(replace(d, shell=shell, optics=optics), d.plate.force_n)
    return {
        "longest_mm": CAP_SCREWS["M1.6"].stock_mm[-1],
        "stocked": stock_note(d) or f"{d.screw.thread} x {d.screw.length_mm:g} is stocked",
        "under_head": f"{under_mm:.2g} mm" if under_mm > 0 else "nothing",
        "bears_mm": d.z_head_mm - d.z_back_mm,
        "beside_mm": (d.frame.wall_y_mm - d.screw.row.clearance_mm) / 2,
        "notched": _notched(d),
        "plate_mm": [2 * half_mm for half_mm in d.acrylic_half_mm],
        "thin_mm": thin.deflection_mm,
        "edges": "four" if d.shell.ledge_x_mm > 0 else "two",
        "press": response,
        "of_depth": 100 * response.deflection_mm / d.plate.depth_mm,
        "strain": 100 * d.snap_strain,
        "strain_limit": 100 * d.cover.strain_limit,
        "paper_ma": 1000 * (PAPER_SUPPLY_V - d.light.led_v) / PAPER_RESISTOR_OHM,
        "sold_ohm": resistor_for_ohm(20.0, d.light)[1],
        "room_mm": room_mm,
        "strip_room": f"{room_mm - strip:.2g} mm" if room_mm > strip else "nothing",
        "camera": f"unverified ({len(lens)} keys): measure yours" if lens else "measured",
        "side_mm": side_mm,
        "within": "wider than" if side_mm < PAPER_PATTERN_MM else "within",
        "deep": 100 * PAPER_PRESS_MM / d.skin.thickness_mm,
        "sheared_mm": d.skin.length_mm / 2 - PAPER_SHEAR_MM,
    }


def _notched(d: Design) -> str:
    """Describe the notches around the posts."""
    parts = {"skin": d.post_in_window_mm, "acrylic": d.acrylic_notch_mm}
    names = [name for name, notch in parts.items() if any(notch)]
    if not names:
        return "the walls of the frame carry them"
    return f"{' and '.join(names)} {'are' if len(names) > 1 else 'is'} notched around them"
