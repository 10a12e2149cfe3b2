"""The drawn image and the stored truth are one displacement field."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from deltact_fab.errors import SolverError
from deltact_fab.imaging import ImageSensor
from deltact_fab.optics import Pinhole, PointSampler, SurfaceLattice
from deltact_fab.patterns import recipe_from_options
from deltact_fab.rig.simulator import SimulatorConfig
from deltact_fab.shapes import SensorDimensions
from deltact_fab.virtual.drawing import noise_of, printed, resting
from deltact_fab.virtual.picture import FrameRenderer, Geometry, Texture

CAMERA = Pinhole(0.0378, 160, 120, 12.85)
LATTICE = SurfaceLattice(-7.0, -6.0, 0.25, 57, 49)
NOISELESS = ImageSensor(blur_px=0.4, shading=0.0, full_well_electrons=1e9, read_noise_electrons=0.0)


def nodes() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    x = LATTICE.x0_mm + LATTICE.spacing_mm * np.arange(LATTICE.nx)
    y = LATTICE.y0_mm + LATTICE.spacing_mm * np.arange(LATTICE.ny)
    return x, y


def bump(amplitude_mm: float) -> NDArray[np.float64]:
    """A bump that moves to +x and in, (ny, nx, 3)."""
    x, y = np.meshgrid(*nodes())
    g = np.exp(-(x**2 + y**2) / (2 * 0.8**2))
    return np.stack((amplitude_mm * g, 0.3 * amplitude_mm * g, -0.5 * amplitude_mm * g), axis=-1)


def ramp_texture() -> Texture:
    """Reflectance linear in x (red) and y (green), so a pixel's colour tells where it came from."""
    y, x = np.mgrid[:700, :700] / 699
    return Texture(np.stack((x, y, 0.5 * np.ones_like(x)), -1).astype(np.float32), 0.02)


def test_every_pixel_sees_the_point_that_projects_there() -> None:
    picture = FrameRenderer(Geometry(CAMERA, LATTICE), ramp_texture(), NOISELESS)
    u = bump(0.9)
    at = picture.geometry.material_px(u)[1:-1, 1:-1].astype(float)
    xy = CAMERA.rest_mm(at).reshape(-1, 2)[::37]
    moved = PointSampler(LATTICE, xy)(u)
    landed = CAMERA.project_px(np.column_stack((xy, np.zeros(len(xy)))) + moved)
    rows, columns = np.mgrid[: CAMERA.height_px, : CAMERA.width_px]
    wanted = np.stack((columns, rows), -1).reshape(-1, 2)[::37]
    # What is left is the linear interpolation of the field between pixels.
    assert np.max(np.abs(landed - wanted)) < 0.02


def test_a_skin_that_ends_within_the_margin_of_the_view_is_drawn_as_a_wider_one() -> None:
    u = bump(0.9)
    narrow = SurfaceLattice(-4.0, -6.0, 0.25, 33, 49)  # the view and its margin reach to 5.4 mm
    cut = Geometry(CAMERA, narrow).material_px(u[:, 12:-12])
    assert np.max(np.abs(cut - Geometry(CAMERA, LATTICE).material_px(u))) < 0.01


def test_image_axes_are_sensor_axes() -> None:
    image = FrameRenderer(Geometry(CAMERA, LATTICE), ramp_texture(), NOISELESS).render(
        None, np.random.default_rng(0)
    )
    blue, green, red = (image[..., c].astype(int) for c in range(3))
    assert red[60, 120] > red[60, 40] + 20  # +x to the right
    assert green[90, 80] > green[30, 80] + 20  # +y down
    assert abs(int(blue[60, 40]) - int(blue[60, 120])) <= 3


def test_a_face_turned_over_is_refused_not_drawn() -> None:
    x, _ = np.meshgrid(*nodes())
    mirrored = np.zeros((LATTICE.ny, LATTICE.nx, 3))
    mirrored[..., 0] = -2 * x
    picture = FrameRenderer(Geometry(CAMERA, LATTICE), ramp_texture(), NOISELESS)
    with pytest.raises(SolverError, match="see no point of the surface"):
        picture.render(mirrored, np.random.default_rng(0))


def test_each_press_of_each_seed_has_noise_of_its_own() -> None:
    drawn = [noise_of(*of).random() for of in ((1, 1), (1, 2), (2, 1), (1, 1))]
    assert len(set(drawn)) == 3
    assert drawn[0] == drawn[3]


def test_beside_a_small_sticker_is_bare_film_and_no_stripe() -> None:
    small = recipe_from_options(None, 0.4, 0.6, size_mm=12.0)
    face = resting(SensorDimensions())
    image = printed(SimulatorConfig(), small, face, 1).render(None, np.random.default_rng(0))
    inside, beside = image[250:350, 350:450], image[250:350, :100]
    assert inside.std() > 50
    assert beside.std() < 10
    assert beside.mean() > 180
