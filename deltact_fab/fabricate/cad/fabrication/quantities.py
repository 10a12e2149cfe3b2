"""Figures of the fabrication: silicone to weigh, coats, cure, light; and where the paper's numbers
contradict each other or say nothing, and what was chosen. No CAD kernel.

The figures that no design has stand in quantities.toml, each with what it rests on; the sentences
about the paper in paper_gaps.toml.
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

_FIGURE_TABLES = tomllib.loads(asset("quantities.toml").read_text(encoding="utf-8"))
_FIGURE_TABLES["film_margin_mm"]["value"] = SkinDimensions.film_margin_mm
FABRICATION_FIGURES: list[dict[str, Any]] = [
    {"key": key, **row} for key, row in _FIGURE_TABLES.items()
]
"""What chemistry and electricity add to the dimensions: key, value, unit, meaning, basis."""
DEFAULT_FIGURES = SimpleNamespace(**{row["key"]: row["value"] for row in FABRICATION_FIGURES})
"""The values by key."""
WASTE_SHARE = 0.1
"""Share of silicone on top that stays in cup and on spatula."""
# Of the paper.
PAPER_PATTERN_MM = 35.0
PAPER_PLATE_MM = 2.0
PAPER_PRESS_MM = PAPER_SHEAR_MM = 10.0
PAPER_STRIP_MM = 10.0


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
    """Skins of one mold = columns x rows."""
    return design.mold.columns * design.mold.rows


def pours(design: Design, sensors: int) -> int:
    """Fillings of the mold for so many sensors, the last one perhaps not full."""
    return math.ceil(sensors / cavities(design))


def skins_batch(design: Design, skins: int) -> Batch:
    """Solaris for a number of skins.

    The paper says 1:1 and not by what: both parts are taken to be equally dense, so that equal
    masses are equal volumes.
    """
    volume_cm3 = skins * design.skin_volume_mm3 / 1000 * (1 + WASTE_SHARE)
    half_g = volume_cm3 * DEFAULT_FIGURES.density_g_cm3 / 2
    return Batch(volume_cm3, half_g, half_g)


def coat_batch(design: Design, sensors: int, waste: float = WASTE_SHARE) -> Batch:
    """Dragon Skin 10 FAST for one layer on so many sensors, what adheres and `waste` of it.

    It lies on the face and on the sides that stand proud; fillets count as edges.
    """
    skin = design.skin
    sides_mm2 = 2 * (skin.width_mm + skin.length_mm) * skin.protrusion_mm
    coated_mm2 = skin.width_mm * skin.length_mm + sides_mm2
    volume_cm3 = sensors * coated_mm2 * DEFAULT_FIGURES.coat_mm / 1000 * (1 + waste)
    half_g = volume_cm3 * DEFAULT_FIGURES.coat_density_g_cm3 / 2
    return Batch(volume_cm3, half_g, half_g, 2 * half_g * DEFAULT_FIGURES.coat_pigment)


def least_coat_batch(batch: Batch) -> Batch:
    """The same mixture, enlarged to what can be weighed."""
    scale = max(1.0, DEFAULT_FIGURES.coat_batch_g / (batch.a_g + batch.b_g))
    return Batch(*(scale * v for v in asdict(batch).values()))


def primer_ml(design: Design, sensors: int) -> float:
    """Primer for one face of so many acrylic plates."""
    x, y = design.acrylic_half_mm
    return sensors * 4 * x * y / 100 * DEFAULT_FIGURES.primer_ml_per_cm2


def shrinkage_mm(design: Design) -> float:
    """What the skin's thickness loses from the cabinet to the room, when it is cured warm."""
    cooled = DEFAULT_FIGURES.cure_warm_c - DEFAULT_FIGURES.cure_room_c
    return design.skin.thickness_mm * DEFAULT_FIGURES.expansion_per_k * cooled


# Light.


def resistor_for_ohm(total_ma: float, light: LightDimensions) -> tuple[float, float]:
    """The resistor that gives this current in all, and the next of E24 that gives no more.

    0 where the strip's own resistors leave no more than that. Raises InputError where the supply is
    below the LEDs' voltage.
    """
    room_v = light.supply_v - light.led_v
    if not (room_v > 0 and total_ma > 0):
        raise InputError(
            f"light.supply_v > light.led_v, {light.led_v:g} V, and a current > 0: "
            f"{light.supply_v:g} V and {total_ma:g} mA fails"
        )
    exact = max(room_v / total_ma * 1000 - light.strip_resistor_ohm / light.led_count, 0.0)
    return exact, next_e24(exact)


# The paper's gaps.


def gaps(design: Design) -> list[dict[str, str]]:
    """Every contradiction and gap, the figures of this design worked in.

    said: the paper. found: why that does not do. chosen: what this design does instead.
    """
    return fill_tables("paper_gaps", d=design, f=_figures(design))["gap"]


def fill_tables(file: str, **values: Any) -> dict[str, list[dict[str, str]]]:
    """The tables of a TOML file of the assets, values worked into their texts."""
    text = asset(f"{file}.toml").read_text(encoding="utf-8")
    return {
        name: [{key: said.format(**values) for key, said in row.items()} for row in rows]
        for name, rows in tomllib.loads(text).items()
    }


def _figures(d: Design) -> dict[str, Any]:
    under_mm = d.cover.floor_mm - d.screw.row.head_height_mm
    room_mm = d.z_joint_mm - d.z_board_front_mm
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
        "paper_ma": LightDimensions(resistor_ohm=750.0, supply_v=5.0).total_ma,
        "sold_ohm": resistor_for_ohm(20.0, d.light)[1],
        "room_mm": room_mm,
        "strip_room": f"{room_mm - PAPER_STRIP_MM:.2g} mm"
        if room_mm > PAPER_STRIP_MM
        else "nothing",
        "camera": f"unverified ({len(lens)} keys): measure yours" if lens else "measured",
        "side_mm": side_mm,
        "within": "wider than" if side_mm < PAPER_PATTERN_MM else "within",
        "deep": 100 * PAPER_PRESS_MM / d.skin.thickness_mm,
        "sheared_mm": d.skin.length_mm / 2 - PAPER_SHEAR_MM,
    }


def _notched(d: Design) -> str:
    """What makes room for the posts."""
    parts = {"skin": d.post_in_window_mm, "acrylic": d.acrylic_notch_mm}
    names = [name for name, notch in parts.items() if any(notch)]
    if not names:
        return "the walls of the frame hold them"
    return f"{' and '.join(names)} {'are' if len(names) > 1 else 'is'} notched around them"
