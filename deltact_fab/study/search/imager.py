"""The printer and the camera that a pattern is sought for."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from ...catalog import validate
from ...errors import InputError
from ...imaging import ImageSensor, Printer
from ...optics import Pinhole
from ...rig.simulator import PrinterConfig, SimulatedCameraConfig
from ...shapes import SensorDimensions
from ..request import virtual_rig


@dataclass(frozen=True)
class PatternImager:
    """printer, sensor: models with assumed parameters. mm_per_px: of the resting face."""

    printer: Printer
    sensor: ImageSensor
    mm_per_px: float

    def view(self, field_px: int | None = None) -> Pinhole:
        """The camera over the sensor's view, or over its middle with at most this many pixels.

        Sides are even, for the mosaic.
        """
        sensor = SensorDimensions()
        width_mm, height_mm = sensor.optics.view_mm
        part = 1.0
        if field_px is not None:
            part = min(1.0, math.sqrt(field_px * self.mm_per_px**2 / (width_mm * height_mm)))
        width_px, height_px = (
            2 * math.floor(side_mm * part / self.mm_per_px / 2 + 1e-9)
            for side_mm in (width_mm, height_mm)
        )
        return Pinhole(self.mm_per_px, width_px, height_px, sensor.eye_distance_mm)

    def design(self) -> SensorDimensions:
        """The sensor with this camera."""
        whole, sensor = self.view(), SensorDimensions()
        optics = replace(
            sensor.optics,
            mm_per_px=self.mm_per_px,
            image_width_px=whole.width_px,
            image_height_px=whole.height_px,
        )
        return replace(sensor, optics=optics)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> PatternImager:
        """What `asdict` gave."""
        return cls(Printer(**data["printer"]), ImageSensor(**data["sensor"]), data["mm_per_px"])

    def words(self) -> dict[str, str]:
        """Printer and camera for people."""
        p, s = self.printer, self.sensor
        return {
            "printer": f"{p.dpi} dpi, {p.levels} levels an ink, spread {p.spread_um:g} µm, inks "
            f"misplaced by {p.misregistration_um:g} µm (standard deviation)",
            "camera": f"{self.mm_per_px:g} mm a pixel, blur {s.blur_px:g} px, full well "
            f"{s.full_well_electrons:g} electrons, read noise {s.read_noise_electrons:g}, "
            f"shading {s.shading:g}, Bayer mosaic",
        }


MIN_MM_PER_PX, MAX_MM_PER_PX = 0.012, 0.1
"""2500 px across the view take minutes a pattern; 300 px are too few to track in."""
OPTIONS = ("mm_per_px", *PrinterConfig.model_fields, "blur_px", "full_well_electrons",
           "read_noise_electrons")  # fmt: skip
"""What may be asked for by name; everything else is the rig file's."""


def bench_of(rig: str, more: dict[str, Any]) -> PatternImager:
    """Printer and camera of a virtual rig's file, changed by the given options.

    more: values of OPTIONS by name, None where nothing was asked. Raises InputError for a rig that
    is not virtual, an unknown option, or a value out of range.
    """
    asked = {key: value for key, value in more.items() if value is not None}
    if unknown := sorted(set(asked) - set(OPTIONS)):
        raise InputError(f"pattern-search: {unknown[0]}: no such option; {', '.join(OPTIONS)}")
    mm_per_px = asked.pop("mm_per_px", SensorDimensions().optics.mm_per_px)
    if not MIN_MM_PER_PX <= mm_per_px <= MAX_MM_PER_PX:  # NaN fails too
        raise InputError(
            f"pattern-search: mm_per_px: {mm_per_px:g}; {MIN_MM_PER_PX} to {MAX_MM_PER_PX} mm "
            "of the face a pixel can be simulated"
        )
    tables = virtual_rig(rig)[0].virtual
    printer, camera = (
        validate(
            kind,
            table.model_dump() | {k: v for k, v in asked.items() if k in kind.model_fields},
            "pattern-search",
        )
        for kind, table in ((PrinterConfig, tables.printer), (SimulatedCameraConfig, tables.camera))
    )
    return PatternImager(
        Printer(**printer.model_dump()), ImageSensor(**camera.model_dump()), float(mm_per_px)
    )
