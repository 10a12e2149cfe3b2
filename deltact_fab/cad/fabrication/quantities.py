"""Figures of the fabrication: silicone to weigh, coats, cure, light. No CAD kernel.

Every figure says on what it rests: `paper` (Fabrication Process, Hardware Design), `maker` (what
the maker states) or `assumed` (ours: check it before relying on it).
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal

from ...errors import InputError
from ...shapes.sensor import FILM_MARGIN_MM
from ..dimensions import Design
from ..sensor_sections import LightDimensions
from ..standards import next_e24

Basis = Literal["paper", "maker", "assumed"]


def _figure(value: float, unit: str, meaning: str, basis: Basis) -> Any:
    return field(default=value, metadata={"unit": unit, "meaning": meaning, "basis": basis})


@dataclass(frozen=True)
class Process:
    """What chemistry and electricity add to the dimensions."""

    density_g_cm3: float = _figure(
        1.0, "g/cm³", "density of Solaris, both parts; read the label", "assumed"
    )
    cure_room_h: float = _figure(16, "h", "cure of Solaris at 23 °C", "paper")
    cure_warm_low_h: float = _figure(8, "h", "cure of Solaris at 65 °C, shortest", "paper")
    cure_warm_h: float = _figure(10, "h", "cure of Solaris at 65 °C, longest", "paper")
    cure_room_c: float = _figure(23, "°C", "room temperature", "paper")
    cure_warm_c: float = _figure(65, "°C", "cabinet", "paper")
    work_min: float = _figure(
        30, "min", "Solaris, first stir to last plate; read the pot life", "assumed"
    )
    stir_min: float = _figure(3, "min", "stirring, walls and bottom scraped", "assumed")
    degas_min: float = _figure(5, "min", "under vacuum after the foam has collapsed", "assumed")
    degas_mbar: float = _figure(50, "mbar", "absolute pressure for degassing, or lower", "assumed")
    foam_factor: float = _figure(4, "×", "volume of the cup over that of the mixture", "assumed")
    expansion_per_k: float = _figure(3e-4, "1/K", "linear expansion of silicone", "assumed")
    primer_dry_min: float = _figure(
        60, "min", "PR-1200 in open air before silicone meets it; read its sheet", "assumed"
    )
    primer_ml_per_cm2: float = _figure(0.005, "ml/cm²", "PR-1200, a wet film of 0.05 mm", "assumed")
    film_dry_h: float = _figure(12, "h", "water transfer film, drying", "assumed")
    film_margin_mm: float = _figure(
        FILM_MARGIN_MM, "mm", "film beyond the face, on each side", "assumed"
    )
    coat_mm: float = _figure(0.3, "mm", "each of the two Dragon Skin layers", "assumed")
    coat_density_g_cm3: float = _figure(1.07, "g/cm³", "density of Dragon Skin 10", "assumed")
    coat_pigment: float = _figure(0.03, "g/g", "pigment in Dragon Skin, by weight", "assumed")
    coat_work_min: float = _figure(8, "min", "pot life of Dragon Skin 10 FAST", "maker")
    coat_cure_min: float = _figure(75, "min", "cure of Dragon Skin 10 FAST at 23 °C", "maker")
    coat_batch_g: float = _figure(
        10, "g", "least batch that a 0.1 g balance divides to 2 %", "assumed"
    )
    screw_torque_nm: float = _figure(
        0.05, "N m", "M1.6 cutting its own thread in resin, at most", "assumed"
    )

    def rows(self) -> list[dict[str, Any]]:
        """Every figure with unit, meaning and basis, as a table shows it."""
        values = asdict(self)
        return [{"key": f.name, "value": values[f.name], **f.metadata} for f in fields(self)]


DEFAULT = Process()
WASTE = 0.1
"""Share of silicone on top that stays in cup and on spatula."""


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


def skins_batch(design: Design, skins: int, waste: float = WASTE) -> Batch:
    """Solaris for a number of skins.

    The paper says 1:1 and not by what: both parts are taken to be equally dense, so that equal
    masses are equal volumes.
    """
    volume_cm3 = skins * design.skin_volume_mm3 / 1000 * (1 + waste)
    half_g = volume_cm3 * DEFAULT.density_g_cm3 / 2
    return Batch(volume_cm3, half_g, half_g)


def coat_batch(design: Design, sensors: int, waste: float = WASTE) -> Batch:
    """Dragon Skin 10 FAST for one layer on so many sensors, what adheres and `waste` of it.

    It lies on the face and on the sides that stand proud; fillets count as edges.
    """
    skin = design.skin
    sides_mm2 = 2 * (skin.width_mm + skin.length_mm) * skin.protrusion_mm
    coated_mm2 = skin.width_mm * skin.length_mm + sides_mm2
    volume_cm3 = sensors * coated_mm2 * DEFAULT.coat_mm / 1000 * (1 + waste)
    half_g = volume_cm3 * DEFAULT.coat_density_g_cm3 / 2
    return Batch(volume_cm3, half_g, half_g, 2 * half_g * DEFAULT.coat_pigment)


def least_coat_batch(batch: Batch) -> Batch:
    """The same mixture, enlarged to what can be weighed."""
    scale = max(1.0, DEFAULT.coat_batch_g / (batch.a_g + batch.b_g))
    return Batch(*(scale * v for v in asdict(batch).values()))


def primer_ml(design: Design, sensors: int) -> float:
    """Primer for one face of so many acrylic plates."""
    x, y = design.acrylic_half_mm
    return sensors * 4 * x * y / 100 * DEFAULT.primer_ml_per_cm2


def shrinkage_mm(design: Design) -> float:
    """What the skin's thickness loses from the cabinet to the room, when it is cured warm."""
    cooled = DEFAULT.cure_warm_c - DEFAULT.cure_room_c
    return design.skin.thickness_mm * DEFAULT.expansion_per_k * cooled


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
