"""The printer and the camera that a pattern is sought for: a virtual rig and a sensor."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from ...catalog import validate
from ...errors import InputError
from ...rig.config import VirtualConfig
from ...rig.simulator import PrinterConfig, SimulatedCameraConfig
from ...shapes import SensorDimensions
from ..request import virtual_rig

MIN_MM_PER_PX, MAX_MM_PER_PX = 0.012, 0.1
"""2500 px across the view take minutes a pattern; 300 px are too few to track in."""
OPTIONS = ("mm_per_px", *PrinterConfig.model_fields, "blur_px", "full_well_electrons",
           "read_noise_electrons")  # fmt: skip
"""What may be asked for by name; everything else is the rig file's."""


def bench_of(rig: str, more: dict[str, Any]) -> tuple[VirtualConfig, SensorDimensions]:
    """A virtual rig and the sensor before it, changed by the given options; a pinhole, no lens.

    more: values of OPTIONS by name, None where nothing was asked. Sides of the image are even, for
    the mosaic. Raises InputError for a rig that is not virtual, an unknown option, or a value out
    of range.
    """
    asked = {key: value for key, value in more.items() if value is not None}
    if unknown := sorted(set(asked) - set(OPTIONS)):
        raise InputError(f"pattern-search: {unknown[0]}: no such option; {', '.join(OPTIONS)}")
    sensor, config = SensorDimensions(), virtual_rig(rig)[0]
    scale = float(asked.pop("mm_per_px", sensor.optics.mm_per_px))
    if not MIN_MM_PER_PX <= scale <= MAX_MM_PER_PX:  # NaN fails too
        raise InputError(
            f"pattern-search: mm_per_px: {scale:g}; {MIN_MM_PER_PX} to {MAX_MM_PER_PX} mm "
            "of the face a pixel can be simulated"
        )
    width, height = (2 * math.floor(mm / scale / 2 + 1e-9) for mm in sensor.optics.view_mm)
    optics = replace(sensor.optics, mm_per_px=scale, image_width_px=width, image_height_px=height)
    tables: dict[str, Any] = {"lens": None}
    for name, kind in (("printer", PrinterConfig), ("camera", SimulatedCameraConfig)):
        changed = {key: value for key, value in asked.items() if key in kind.model_fields}
        table = getattr(config.virtual, name).model_dump() | changed
        tables[name] = validate(kind, table, "pattern-search")
    simulator = config.virtual.model_copy(update=tables)
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
