"""How a bench draws: the cut of the face that the camera sees, its geometry, and a printed gel."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..imaging import ImageSensor, Printer
from ..optics import Fisheye, Pinhole, Rectified, SurfaceLattice
from ..patterns.raster import albedo
from ..patterns.recipe import PatternRecipe
from ..rig.config import VirtualConfig
from ..rig.simulator import SimulatorConfig
from ..shapes import SensorDimensions
from .picture import MARGIN_PX, FrameRenderer, Geometry, Texture
from .raw_view import BAND_PX, RawView
from .scene import LatticeCrop

if TYPE_CHECKING:
    from ..aliases import Field

RESTING_MM = 1.0  # between the nodes of a face that does not move


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


def resting(sensor: SensorDimensions) -> Geometry:
    """What each pixel of the design's own pinhole sees of a face that nothing touches."""
    camera = Pinhole.of(sensor)
    half_mm = [side / 2 + MARGIN_PX * camera.mm_per_px for side in sensor.optics.view_mm]
    nx, ny = (2 * math.ceil(half / RESTING_MM) + 1 for half in half_mm)
    x_mm, y_mm = (-(n - 1) / 2 * RESTING_MM for n in (nx, ny))
    return Geometry(camera, SurfaceLattice(x_mm, y_mm, RESTING_MM, nx, ny))


def printed(
    simulator: SimulatorConfig, recipe: PatternRecipe, geometry: Geometry, seed: int
) -> FrameRenderer:
    """The gel with that pattern as the rig's printer made it, before the rig's camera.

    Where a sticker is smaller than the view the camera sees bare film beside it.
    """
    printer = Printer(**simulator.printer.model_dump())
    camera = geometry.camera
    view_mm = max(camera.width_px, camera.height_px) * camera.mm_per_px
    side_px = math.ceil(max(recipe.printed_mm, view_mm) / printer.mm_per_dot - 1e-9)
    rng = np.random.default_rng(np.random.SeedSequence([seed, 3]))
    values = printer.print_(albedo(recipe, printer.mm_per_dot, (side_px, side_px)), rng)
    exposure = ImageSensor(**simulator.camera.model_dump())
    return FrameRenderer(geometry, Texture(values, printer.mm_per_dot), exposure)


def noise_of(seed: int, stream: int) -> np.random.Generator:
    """The camera's noise in one press, by the number of its name: it does not know the others."""
    return np.random.default_rng(np.random.SeedSequence([seed, 2, stream]))
