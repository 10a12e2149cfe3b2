"""The drawn image and the stored truth are one displacement field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from deltact_fab.bench.rig.config import SimulatorConfig
from deltact_fab.common.errors import SolverError
from deltact_fab.fabricate.patterns.recipe import choose_recipe
from deltact_fab.sensor.optics.camera import Pinhole
from deltact_fab.sensor.optics.fisheye import Fisheye
from deltact_fab.sensor.optics.lattice import PointSampler, SurfaceLattice
from deltact_fab.sensor.optics.rectified import Rectified
from deltact_fab.sensor.shapes.imaging import CAMERA_GAMMA, ImageSensor
from deltact_fab.sensor.shapes.sensor import SensorDimensions
from deltact_fab.simulate.virtual.picture import BAND_PX, FrameRenderer, PictureGeometry, RawView

CAMERA = Pinhole(0.0378, 160, 120, 12.85)
LATTICE = SurfaceLattice(-7.0, -6.0, 0.25, 57, 49)
NOISELESS = ImageSensor(blur_px=0.4, shading=0.0, full_well_electrons=1e9, read_noise_electrons=0.0)


def bump(
    amplitude_mm: float, lattice: SurfaceLattice = LATTICE, sigma_mm: float = 0.8
) -> NDArray[np.float64]:
    """A bump that moves to +x and in, (ny, nx, 3)."""
    x, y = np.meshgrid(*lattice.axes_mm())
    g = np.exp(-(x**2 + y**2) / (2 * sigma_mm**2))
    return np.stack((amplitude_mm * g, 0.3 * amplitude_mm * g, -0.5 * amplitude_mm * g), axis=-1)


def ramp_texture() -> NDArray[np.float32]:
    """Reflectance linear in x (red) and y (green), so a pixel's colour tells where it came from."""
    y, x = np.mgrid[:700, :700] / 699
    return np.asarray(np.stack((x, y, 0.5 * np.ones_like(x)), -1), np.float32)


def test_pixels_see_the_projected_points() -> None:
    picture = FrameRenderer(PictureGeometry(CAMERA, LATTICE), ramp_texture(), 0.02, NOISELESS)
    u = bump(0.9)
    at = picture.geometry.material_px(u)[1:-1, 1:-1].astype(float)
    xy = CAMERA.rest_mm(at).reshape(-1, 2)[::37]
    moved = PointSampler(LATTICE, xy)(u)
    landed = CAMERA.project_px(np.column_stack((xy, np.zeros(len(xy)))) + moved)
    rows, columns = np.mgrid[: CAMERA.height_px, : CAMERA.width_px]
    wanted = np.stack((columns, rows), -1).reshape(-1, 2)[::37]
    # What is left is the linear interpolation of the field between pixels.
    assert np.max(np.abs(landed - wanted)) < 0.02


def test_skin_ending_in_margin_is_extended() -> None:
    u = bump(0.9)
    narrow = SurfaceLattice(-4.0, -6.0, 0.25, 33, 49)  # the view and its margin reach to 5.4 mm
    cut = PictureGeometry(CAMERA, narrow).material_px(u[:, 12:-12])
    assert np.max(np.abs(cut - PictureGeometry(CAMERA, LATTICE).material_px(u))) < 0.01


def test_image_axes_are_sensor_axes() -> None:
    image = FrameRenderer(PictureGeometry(CAMERA, LATTICE), ramp_texture(), 0.02, NOISELESS).render(
        None, np.random.default_rng(0)
    )
    blue, green, red = (image[..., c].astype(int) for c in range(3))
    assert red[60, 120] > red[60, 40] + 20  # +x to the right
    assert green[90, 80] > green[30, 80] + 20  # +y down
    assert abs(int(blue[60, 40]) - int(blue[60, 120])) <= 3


@pytest.mark.parametrize("grey", [40.0, 120.0, 220.0])
def test_exposure_meets_grey_at_rest(grey: float) -> None:
    """At 220 a part of the picture is white."""
    sensor = replace(NOISELESS, auto_exposure_grey=grey, contact_glow_per_mm=1.0)
    picture = FrameRenderer(PictureGeometry(CAMERA, LATTICE), ramp_texture(), 0.02, sensor)
    rest, pressed = (picture.render(u, np.random.default_rng(0)) for u in (None, bump(0.9)))
    assert rest.mean() == pytest.approx(grey, abs=1.5)
    assert pressed.mean() > rest.mean() + 1  # not set again


def test_folded_face_is_refused() -> None:
    x, _ = np.meshgrid(*LATTICE.axes_mm())
    mirrored = np.zeros((LATTICE.ny, LATTICE.nx, 3))
    mirrored[..., 0] = -2 * x
    picture = FrameRenderer(PictureGeometry(CAMERA, LATTICE), ramp_texture(), 0.02, NOISELESS)
    with pytest.raises(SolverError, match="see no point of the surface"):
        picture.render(mirrored, np.random.default_rng(0))


def test_noise_differs_by_press_and_seed() -> None:
    drawn = [FrameRenderer.noise(*of).random() for of in ((1, "1"), (1, "2"), (2, "1"), (1, "1"))]
    assert len(set(drawn)) == 3
    assert drawn[0] == drawn[3]


def test_bare_film_around_small_sticker() -> None:
    small = choose_recipe(None, 0.4, 0.6, size_mm=12.0)
    face = PictureGeometry.resting(SensorDimensions())
    image = FrameRenderer.printed(face, SimulatorConfig(), small, 1).render(
        None, np.random.default_rng(0)
    )
    inside, beside = image[250:350, 350:450], image[250:350, :100]
    assert inside.std() > 50
    assert beside.std() < 10
    assert beside.mean() > 180


# Through a lens: agreement with the lens's own exact projection

LENS = Fisheye(
    cx_px=205.0, cy_px=172.5, tilt_x_deg=2.0, roll_deg=1.0, k1=-0.02, x0_mm=0.1, air_gap_mm=3.1,
    pupil_shift_mm=0.2, width_px=420, height_px=340,
)  # fmt: skip
VIEW = Rectified(LENS, 0.0378, 200, 150)
RAW_LATTICE = SurfaceLattice(-10.0, -9.0, 0.25, 81, 73)
TEXEL_MM = 0.01


def dots(at_mm: NDArray[np.float64], half_mm: float = 8.0) -> NDArray[np.float32]:
    """Small bright spots on black, (n, 2) mm."""
    side = round(2 * half_mm / TEXEL_MM) + 1
    texture = np.zeros((side, side, 3), np.float32)
    reach = np.arange(-12, 13)
    for x, y in at_mm:
        j, i = (round((v + half_mm) / TEXEL_MM) for v in (x, y))
        spot = np.exp(-np.add.outer(reach**2, reach**2) / (2 * 4.0**2))
        texture[i - 12 : i + 13, j - 12 : j + 13] = spot[..., None]
    return texture


def middles(image: NDArray[np.uint8], near_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centroids (n, 2) of light within 4 px of each place."""
    light = (image.mean(axis=-1) / 255.0) ** CAMERA_GAMMA
    found = []
    for x, y in np.rint(near_px).astype(int):
        rows, columns = np.mgrid[y - 4 : y + 5, x - 4 : x + 5]
        w = light[y - 4 : y + 5, x - 4 : x + 5]
        found.append((np.sum(w * columns) / w.sum(), np.sum(w * rows) / w.sum()))
    return np.array(found)


@pytest.mark.parametrize("pressed", [False, True])
def test_spots_follow_the_lens_projection(pressed: bool) -> None:
    grid = np.stack(np.meshgrid(np.arange(-3.5, 3.6, 0.7), np.arange(-2.45, 2.5, 0.7)), -1)
    at_mm = grid.reshape(-1, 2)
    u = bump(1.0, RAW_LATTICE, 1.2) if pressed else np.zeros((RAW_LATTICE.ny, RAW_LATTICE.nx, 3))
    moved = np.column_stack((at_mm, np.zeros(len(at_mm)))) + PointSampler(RAW_LATTICE, at_mm)(u)
    wanted_px = LENS.project_px(moved)
    picture = FrameRenderer(
        PictureGeometry(RawView(LENS, VIEW), RAW_LATTICE), dots(at_mm), TEXEL_MM, NOISELESS
    )
    image = picture.render(u if pressed else None, np.random.default_rng(0))
    assert image.shape == (340, 420, 3)
    off_px = middles(image, wanted_px) - wanted_px
    assert np.abs(off_px.mean(axis=0)).max() < 0.03
    # A spot is as wide as the print's blur: where the face is bent its middle is not that of a dot.
    assert np.hypot(*off_px.T).max() < (0.15 if pressed else 0.1)
    # And in the rectified view they are at rest where they were printed.
    if not pressed:
        seen_px = VIEW.rest_px(at_mm)
        off_px = middles(VIEW.rectify(image), seen_px) - seen_px
        assert np.abs(off_px.mean(axis=0)).max() < 0.05


def test_margin_is_drawn_then_dark() -> None:
    white = np.ones((1601, 1601, 3), np.float32)
    raw = RawView(LENS, VIEW)
    image = FrameRenderer(PictureGeometry(raw, RAW_LATTICE), white, TEXEL_MM, NOISELESS).render(
        None, np.random.default_rng(0)
    )
    x, y = np.meshgrid(np.arange(420.0), np.arange(340.0))
    looks_px = VIEW.rest_px(LENS.rest_mm(np.stack((x, y), -1)))
    past = np.maximum(-looks_px, looks_px - (199, 149)).max(axis=-1)
    light = image.min(axis=-1)
    assert light[past < BAND_PX - 4].min() > 200
    assert image[past > BAND_PX + 4].max() == 0
    away = np.hypot(*np.moveaxis(raw.offset, -1, 0))
    corner = np.argmin(np.hypot(*np.moveaxis(looks_px - (199, 149), -1, 0)))
    assert away.ravel()[corner] == pytest.approx(1.0, abs=0.01)
    assert away.min() < 0.01


def test_dark_beyond_the_print() -> None:
    small = np.ones((301, 301, 3), np.float32)  # 3 mm, in a view of 7.6 mm
    image = FrameRenderer(
        PictureGeometry(RawView(LENS, VIEW), RAW_LATTICE), small, TEXEL_MM, NOISELESS
    ).render(None, np.random.default_rng(0))
    x, y = LENS.rest_px(np.array([1.4, 0.0])).round().astype(int)
    assert image[y, x].min() > 200
    x, y = LENS.rest_px(np.array([1.65, 0.0])).round().astype(int)
    assert image[y, x].max() == 0
