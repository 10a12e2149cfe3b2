"""How a bench draws: the cut of the face that the camera sees, its geometry, and a printed gel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..imaging import ImageSensor, Printer
from ..optics import Fisheye, Pinhole, Rectified, SurfaceLattice
from ..patterns.raster import albedo
from ..patterns.recipe import PatternRecipe
from ..rig.config import VirtualConfig
from ..shapes import SensorDimensions
from .picture import MARGIN_PX, FrameRenderer, Geometry, Texture
from .raw_view import BAND_PX, RawView
from .scene import LatticeCrop

if TYPE_CHECKING:
    from ..aliases import Field


def crop_of(
    config: VirtualConfig, sensor: SensorDimensions, axes_mm: tuple[Field, Field]
) -> LatticeCrop:
    """The part of a gel's lattice, with nodes (nx,) and (ny,), that the rig's camera can see."""
    optics = sensor.optics
    view = optics.view_mm
    margin_px = MARGIN_PX + (BAND_PX if config.virtual.lens is not None else 0)
    margin_mm = margin_px * optics.mm_per_px
    return LatticeCrop(*axes_mm, (view[0] / 2 + margin_mm, view[1] / 2 + margin_mm))


def geometry_of(
    config: VirtualConfig,
    sensor: SensorDimensions,
    view: Pinhole | Rectified,
    lattice: SurfaceLattice,
) -> tuple[Geometry, Fisheye | None]:
    """What each pixel sees, and the true lens it sees through; None: a pinhole.

    view: of the images that are tracked.
    """
    if not isinstance(view, Rectified):
        return Geometry(view, lattice), None
    from .lens import true_lens

    lens = true_lens(config, sensor)
    return Geometry(RawView(lens, view), lattice), lens


def printed(
    config: VirtualConfig, recipe: PatternRecipe, geometry: Geometry, seed: int
) -> FrameRenderer:
    """The gel with that pattern as the rig's printer made it, before the rig's camera."""
    simulator = config.virtual
    printer = Printer(**simulator.printer.model_dump())
    rng = np.random.default_rng(np.random.SeedSequence([seed, 3]))
    values = printer.print_(albedo(recipe, printer.mm_per_dot), rng)
    exposure = ImageSensor(**simulator.camera.model_dump())
    return FrameRenderer(geometry, Texture(values, printer.mm_per_dot), exposure)


def noise_of(seed: int, stream: int) -> np.random.Generator:
    """The camera's noise in one press, by the number of its name: it does not know the others."""
    return np.random.default_rng(np.random.SeedSequence([seed, 2, stream]))
