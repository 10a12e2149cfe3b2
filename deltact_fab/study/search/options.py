"""Printer and camera of a search: a rig file's, and the options that change them."""

from __future__ import annotations

from typing import Any

from ...catalog import validate
from ...errors import InputError
from ...imaging import ImageSensor, Printer
from ...rig.config import VirtualConfig, load
from ...rig.simulator import PrinterConfig, SimulatedCameraConfig
from ...shapes import SensorDimensions
from .imager import PatternImager

MIN_MM_PER_PX, MAX_MM_PER_PX = 0.012, 0.1
"""2500 px across the view take minutes a pattern; 300 px are too few to track in."""
OPTIONS = ("mm_per_px", *PrinterConfig.model_fields, "blur_px", "full_well_electrons",
           "read_noise_electrons")  # fmt: skip
"""What may be asked for by name; everything else is the rig file's."""


def rig_of(name: str) -> VirtualConfig:
    """A virtual rig by name or path. Raises InputError for another one."""
    config, path = load(name)
    if config.kind != "virtual":
        raise InputError(
            f"{path}: kind: {config.kind!r} has no model of printer and camera; name a virtual rig"
        )
    return config


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
    tables = rig_of(rig).virtual
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
