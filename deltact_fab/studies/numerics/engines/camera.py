"""Forward camera and lens calibration, against a ray tracer with laws of its own."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from scipy.interpolate import RectBivariateSpline

from deltact_fab.common import Array
from deltact_fab.estimate import LensCalibration
from deltact_fab.sensor import Checkerboard, SurfaceLattice
from deltact_fab.simulate import PictureGeometry

from .. import traced
from ..engine import Case, CurveSetting, Engine, Work

LATTICES_MM = (2.0, 1.0, 0.5, 0.25)  # by hand: to the virtual rig's, by halving
RIG_LATTICE_MM = 0.25  # definition: of `ObservedChannels`
LATTICE_REACH_MM = 17.0, 15.0  # by hand: the view with its margin
# Definition: of the stored corners.
TRACED_SKIN, TRACED_BOARD = Checkerboard(23, 23, 1.5, skin=True), Checkerboard(9, 7, 3.0)
RAW_SIZE_PX = 1280, 720  # definition: of the ray tracer's lens
BOARD_COUNTS = (0, 2, 6)  # by hand: of those in the air
CORNER_NOISE_PX = 0.05  # measured, docs/evidence/lens.md: of the detector
LENS_LAWS = ("equidistant", "equisolid", "stereographic", "seventh order -")
NOISES_PX = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # by hand: from the best to hopeless corners
MAX_SIGMAS = 3.0  # definition: of a stated sigma
SLOWEST_BOARDS = 6  # by hand: all that are stored


def _picture(lattice_mm: float, scratch: Path) -> Work:
    """Face point of each pixel, off by how much at the pixels that see the stored points."""
    presses = traced.TracedPresses.load()
    x_mm, y_mm = (np.arange(-h, h + lattice_mm / 2, lattice_mm) for h in LATTICE_REACH_MM)
    lattice = SurfaceLattice(float(x_mm[0]), float(y_mm[0]), lattice_mm, len(x_mm), len(y_mm))
    displacement_mm = np.stack([
        RectBivariateSpline(presses.y_mm, presses.x_mm, field * traced.UNIT_MM)(y_mm, x_mm)
        for field in np.moveaxis(presses.displacement.astype(float), -1, 0)
    ], axis=-1)  # fmt: skip
    geometry = PictureGeometry(traced.TRACED_VIEW, lattice)
    points = np.stack(np.meshgrid(presses.x_mm, presses.y_mm), axis=-1).reshape(-1, 2)
    shift = presses.shift[presses.imaged].reshape(-1, 2) * traced.UNIT_MM
    rest_px, seen_px = (traced.TRACED_VIEW.rest_px(p) for p in (points, points + shift))
    inside = np.all((seen_px > 2) & (seen_px < np.array(geometry.size_px) - 3), axis=1)

    def error(at_px: Array) -> float:
        sampled_px = traced.sample(at_px, seen_px[inside] + 1)  # a border of one pixel
        return float(np.sqrt(np.mean(np.sum((sampled_px - rest_px[inside]) ** 2, axis=1))))

    return Work(lambda: geometry.material_px(displacement_mm), error)


def _calibrate(law: str, in_air: int, noise_px: float) -> LensCalibration:
    rng, data = np.random.default_rng(in_air), traced.load()

    def points(board: Checkerboard, px: Array) -> tuple[Checkerboard, Array, Array]:
        index = np.stack(np.meshgrid(*map(np.arange, board.corners)), -1).reshape(-1, 2)
        inside = np.isfinite(px[:, 0])
        return board, (px + rng.normal(0, noise_px, px.shape))[inside], index[inside]

    skin = points(TRACED_SKIN, data[f"{law} skin"])
    air = [points(TRACED_BOARD, px) for px in data[f"{law} air"][:in_air]]
    return LensCalibration.from_points([skin], air, RAW_SIZE_PX, traced.TRACED_SENSOR)


def lens_error_px(law: str, depth_mm: float, calibration: LensCalibration) -> float:
    """Error of projected points of the view, 95th percentile, raw px."""
    data, key = traced.load(), f"{depth_mm:g}"
    error_px = calibration.lens.project_px(data[f"{law} points_{key}"]) - data[f"{law} px_{key}"]
    return float(np.percentile(np.linalg.norm(error_px, axis=1), 95))


def _lens(law: str, in_air: int, scratch: Path) -> Work:
    run = partial(_calibrate, law, in_air, CORNER_NOISE_PX)
    return Work(run, partial(lens_error_px, law, traced.LENS_DEPTHS_MM[-1]))


def curves() -> Sequence[CurveSetting]:
    """Face point of each pixel by lattice; calibration by boards in the air."""
    law = LENS_LAWS[1]
    unit_px = traced.UNIT_MM / traced.TRACED_VIEW.mm_per_px
    pictures = [
        CurveSetting("face point of each pixel, ball dragged in the gel", "lattice",
                     f"{h:g} mm", "px rms", "ray tracer", unit_px,
                     partial(_picture, h), "independent solver", h == RIG_LATTICE_MM)
        for h in LATTICES_MM
    ]  # fmt: skip
    return pictures + [
        CurveSetting(f"calibration of a lens, {law}: points 3 mm deep", "skin and boards in air",
                     f"{n} boards", "raw px, 95th percentile", "ray tracer's lens", 0.0,
                     partial(_lens, law, n), "exact", n == SLOWEST_BOARDS)
        for n in BOARD_COUNTS
    ]  # fmt: skip


def _in_sigmas(law: str, in_air: int, noise_px: float, scratch: Path) -> tuple[float, str]:
    """Largest error over its stated sigma."""
    calibration = _calibrate(law, in_air, noise_px)
    sigmas_px = (calibration.face_px, calibration.depth_px[traced.LENS_DEPTHS_MM[1]])
    errors_px = [lens_error_px(law, depth_mm, calibration) for depth_mm in traced.LENS_DEPTHS_MM]
    pairs = list(zip(errors_px, sigmas_px, strict=True))
    note = ", ".join(f"{error:.2g} px of {sigma:.2g}" for error, sigma in pairs)
    return max(error / sigma for error, sigma in pairs), note


def extremes() -> Sequence[Case]:
    """Laws of lenses by noise of the corners."""
    return [
        Case(f"{law}, corners off by {noise:g} px", "right or refused",
             partial(_in_sigmas, law, 2, noise), MAX_SIGMAS, "of its sigma", "px|residual|view",
             (f"Lens from a skin and two boards: error over its sigma (to {MAX_SIGMAS:g})", law,
              f"{noise:g} px"))
        for law in LENS_LAWS for noise in NOISES_PX
    ]  # fmt: skip


def _one_corner(scratch: Path) -> float:
    px = np.array([[640.0, 360.0]])
    LensCalibration.from_points(
        [(TRACED_SKIN, px, np.array([[11, 11]]))], [], RAW_SIZE_PX, traced.TRACED_SENSOR
    )
    return np.nan


def cases(quick: bool) -> Sequence[Case]:
    """A board of which one corner was found."""
    return [Case("lens from one corner", "refused", _one_corner, says="at least 12")]


ENGINE = Engine(
    "Camera and lens",
    "What each pixel sees of the deformed face, and lenses from corners, against a ray tracer.",
    cases,
    curves,
    extremes,
)
