"""The printer and the camera that a pattern is sought for: a virtual rig and a sensor."""

from __future__ import annotations

import math
from dataclasses import replace

from ...catalog import validate
from ...errors import InputError
from ...rig.config import PrinterConfig, VirtualConfig
from ...shapes import SensorDimensions
from ..request import virtual_rig

MIN_MM_PER_PX, MAX_MM_PER_PX = 0.012, 0.1
"""2500 px across the view take minutes a pattern; 300 px are too few to track in."""


def bench_of(
    rig: str, dpi: int | None = None, mm_per_px: float | None = None
) -> tuple[VirtualConfig, SensorDimensions]:
    """A virtual rig, a pinhole without a lens, and the sensor before it.

    dpi: of the printer, mm_per_px: of the camera, None for the rig's and the sensor's. Sides of the
    image are even, for the mosaic. Raises InputError for a rig that is not virtual, or a value out
    of range.
    """
    sensor, config = SensorDimensions(), virtual_rig(rig)[0]
    scale = sensor.optics.mm_per_px if mm_per_px is None else mm_per_px
    if not MIN_MM_PER_PX <= scale <= MAX_MM_PER_PX:  # NaN fails too
        raise InputError(
            f"pattern-search: mm_per_px: {scale:g}; {MIN_MM_PER_PX} to {MAX_MM_PER_PX} mm "
            "of the face a pixel can be simulated"
        )
    width, height = (2 * math.floor(mm / scale / 2 + 1e-9) for mm in sensor.optics.view_mm)
    optics = replace(sensor.optics, mm_per_px=scale, image_width_px=width, image_height_px=height)
    printer = config.virtual.printer
    if dpi is not None:
        printer = validate(PrinterConfig, printer.model_dump() | {"dpi": dpi}, "pattern-search")
    simulator = config.virtual.model_copy(update={"lens": None, "printer": printer})
    config = config.model_copy(update={"virtual": simulator, "camera": None})
    return config, replace(sensor, optics=optics)


def words_of(config: VirtualConfig, sensor: SensorDimensions) -> dict[str, str]:
    """Printer and camera for people."""
    p, s = config.virtual.printer, config.virtual.camera
    return {
        "printer": f"{p.dpi} dpi, {p.levels} levels an ink, spread {p.spread_um:g} µm, inks "
        f"misplaced by {p.misregistration_um:g} µm (standard deviation)",
        "camera": f"{sensor.optics.mm_per_px:g} mm a pixel, blur {s.blur_px:g} px, full well "
        f"{s.full_well_electrons:g} electrons, read noise {s.read_noise_electrons:g}, "
        f"shading {s.shading:g}, Bayer mosaic",
    }
