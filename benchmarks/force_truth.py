"""Presses with shear on the finite-strain gel, as truth for force models; solved once, then kept.

A minute or two each (simulated); what the camera would see of them is computed without images.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache as once

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import gaussian_filter

from deltact_fab.common import cache
from deltact_fab.common.aliases import Array
from deltact_fab.estimate.measure.face import FaceFlow
from deltact_fab.physics.gel.path.knots import Increments, ObservedChannels
from deltact_fab.physics.gel.path.open import choose_level, open_path
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.optics.camera import CameraModel, axes_mm
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SEED = 20
GEL = GelMaterial(modulus_mpa=0.56, poisson=0.49, friction=0.5)
SKIN = SkinDimensions()
BALLS_MM = (10, 12, 15, 18, 22)
SCATTERED = 25
SETTINGS = 10  # of the scattered: the inverse's settings were chosen on them, all else judges
CORNERS = ((0.0, 0.0), (6.0, 0.0), (0.0, 5.0), (6.0, 5.0))  # a quarter of a grid of places
OTHERS = ("cylinder:8", "ellipsoid", "4dots", "hexprism", "2dots", "cylinder")
AROUND = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (0, 0))
MAX_UNKNOWNS = 8000
EVERY = 4
WHITE_PX = 0.05


@dataclass(frozen=True)
class Press:
    """Down to each depth in turn, there around a square of shear offsets and back."""

    name: str
    indenter: str
    place_mm: tuple[float, float]
    depths_mm: tuple[float, ...] = (0.6, 1.2, 1.8)
    shear_mm: float = 0.7


def presses() -> Iterator[Press]:
    """Balls at scattered places, balls on a grid, and other shapes."""
    rng = np.random.default_rng(SEED)
    for i in range(SCATTERED):
        x, y = rng.uniform([-9, -8], [9, 8])
        yield Press(f"scatter-{i:02d}", f"sphere:{BALLS_MM[i % 5]}", (float(x), float(y)))
    for ball in (10, 15, 22):
        for i, place in enumerate(CORNERS):
            yield Press(f"grid-{ball}-{i}", f"sphere:{ball}", place)
    for shape in OTHERS:
        x, y = rng.uniform([-5, -4], [5, 4])
        name = f"other-{shape.replace(':', '')}"
        yield Press(name, shape, (float(x), float(y)), (0.5, 1.0), 0.5)


@once
def solved(press: Press) -> dict[str, Array]:
    """Of each state: tips_mm, force_n, torque_nmm (n, 3), displacement_mm and traction_mpa on
    x_mm, y_mm."""
    key = cache.cache_key("physics.gel.path.open", "sensor.shapes.indenter", press=repr(press),
                    gel=repr(GEL), skin=repr(SKIN), unknowns=MAX_UNKNOWNS)  # fmt: skip
    store = cache.Store("benchmark-press")
    kept: dict[str, Array] | None = store.read(key)
    if kept is None:
        kept = _solved(press)
        store.write(key, kept)
    return kept


def _solved(press: Press) -> dict[str, Array]:
    x, y = press.place_mm
    corners = [(x, y, 0.0)]
    for depth in press.depths_mm:
        corners.append((x, y, -depth))
        corners += [(x + press.shear_mm * i, y + press.shear_mm * j, -depth) for i, j in AROUND]
    poses, shape = Increments(0.75, 0.75).poses(corners), parse_indenter(press.indenter)
    choice = choose_level(
        SKIN, GEL, shape, poses, 0.03, level="hyperelastic", most_unknowns=MAX_UNKNOWNS
    )
    observed = ObservedChannels(fields="all", traction=True, lattice_mm=0.5)
    solver = open_path(SKIN, GEL, shape, poses, observed, choice)
    knots = solver.solve_all()
    modulus = GEL.modulus_mpa
    return {
        "tips_mm": np.array([pose.tip_mm for pose in poses]),
        "force_n": modulus * np.array([knot.force_n for knot in knots]),
        "torque_nmm": modulus * np.array([knot.torque_nmm for knot in knots]),
        "displacement_mm": np.array([knot.displacement_mm for knot in knots], np.float32),
        "traction_mpa": modulus * np.array([knot.traction_mpa for knot in knots], np.float32),
        "x_mm": solver.axes_mm[0],
        "y_mm": solver.axes_mm[1],
    }


def flows(press: Press, camera: CameraModel, noise_px: float, wide_mm: float) -> list[FaceFlow]:
    """What a tracker without other errors would report of each state; noise from the press's name.

    noise_px: rms of an error alike over wide_mm (sigma), on top of WHITE_PX at each pixel; with 0
    there is neither.
    """
    return flows_of(
        solved(press),
        camera,
        noise_px,
        np.random.default_rng([SEED, *press.name.encode()]),
        wide_mm,
    )


def flows_of(
    truth: dict[str, Array], camera: CameraModel, noise_px: float, rng: np.random.Generator,
    wide_mm: float = 1.0,
) -> list[FaceFlow]:  # fmt: skip
    """The same of any face's displacement_mm on x_mm, y_mm."""
    mm = camera.mm_per_px
    whole = (axis[: len(axis) // EVERY * EVERY] for axis in axes_mm(camera))
    xs, ys = (axis.reshape(-1, EVERY).mean(1) for axis in whole)
    rest = np.stack((*np.meshgrid(xs, ys), np.zeros((len(ys), len(xs)))), axis=-1)
    rest_px = camera.project_px(rest)
    found = []
    for moved in truth["displacement_mm"]:
        u = np.empty_like(rest)
        for i in range(3):
            u[..., i] = RectBivariateSpline(truth["y_mm"], truth["x_mm"], moved[..., i])(ys, xs)
        shift = (camera.project_px(rest + u) - rest_px) * mm
        if noise_px:
            sigma = wide_mm / (EVERY * mm)
            error = gaussian_filter(rng.normal(size=shift.shape), (sigma, sigma, 0), mode="wrap")
            shift += error * (noise_px * mm / error.std())
            shift += rng.normal(size=shift.shape) * (WHITE_PX * mm / EVERY)
        found.append(FaceFlow(shift.astype(np.float32), np.ones(rest.shape[:2], bool), xs, ys))
    return found
