"""Lenses of other laws than the product's: what is calibrated is right, or its sigma says how far.

The lenses are formulas of `raytraced`, which refracts with vectors of its own; so are the pictures
of the skin under LED light that is brighter at the edge.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.raytraced import LAWS, Imaging, Lens, Tracer, chessboard
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure.lens.calibration import LensCalibration, lens_from_corners
from deltact_fab.estimate.measure.lens.corners import Corners, find_corners
from deltact_fab.estimate.measure.lens.problem import BoardView
from deltact_fab.estimate.measure.lens.trust import view_mm
from deltact_fab.sensor.optics.checkerboard import Checkerboard
from deltact_fab.sensor.shapes.sensor import SensorDimensions

DESIGN = SensorDimensions()
SKIN, BOARD = Checkerboard(23, 23, 1.5, skin=True), Checkerboard(9, 7, 3.0)
GRADIENTS = (1.04, 1.14, 1.28, 1.5, 1.9, 3.0, 5.8)
LENSES = {
    "equisolid": Lens(law=LAWS["equisolid"]),
    "stereographic": Lens(law=LAWS["stereographic"]),
    "seventh order +": Lens(law=LAWS["seventh order +"]),
    "seventh order -": Lens(law=LAWS["seventh order -"]),
    "seventh and ninth": Lens(law=LAWS["seventh and ninth"]),
    "decentred": Lens(p1=0.0012, p2=-0.0008),
    "aspect": Lens(aspect=1.0015),
    "moving pupil": Lens(shift_mm=lambda t: 0.12 * t**2 + 0.1 * t**4),
}


def corners(
    lens: Lens, board: Checkerboard, at_mm: NDArray[np.float64], rng: np.random.Generator,
    held: bool = False,
) -> Corners | None:  # fmt: skip
    """As a finder has them: those in picture and window, 0.05 px off; None of a board cut."""
    index = np.stack(np.meshgrid(*map(np.arange, board.corners)), -1).reshape(-1, 2)
    px = lens.project_px(at_mm, 1.0 if held else None)
    seen = np.all((px > 6) & (px < np.array(lens.size_px) - 7), -1)
    if held and not seen.all():
        return None
    if not held:
        seen &= np.all(np.abs(at_mm[:, :2]) < DESIGN.skin.opening_half_mm, -1)
    return Corners("corners", board, (px + rng.normal(0, 0.05, px.shape))[seen], index[seen])


def plane_mm(board: Checkerboard) -> NDArray[np.float64]:
    index = np.stack(np.meshgrid(*map(np.arange, board.corners)), -1).reshape(-1, 2)
    return np.column_stack((board.at_mm(index), np.zeros(len(index))))


def seen(lens: Lens, seed: int, in_air: int) -> Iterator[BoardView]:
    """The skin, and boards held in the air."""
    rng = np.random.default_rng([seed, in_air])
    skin = corners(lens, SKIN, plane_mm(SKIN), rng)
    assert skin is not None
    yield BoardView(skin, True)
    while in_air:
        turns = (*rng.uniform(-25, 25, 2), rng.uniform(-15, 15))
        at = Rotation.from_euler("xyz", turns, degrees=True).apply(plane_mm(BOARD))
        at += (*rng.uniform(-5, 5, 2), rng.uniform(3, 20))
        board = corners(lens, BOARD, at, rng, held=True) if at[:, 2].min() > 0.5 else None
        if board is not None:
            in_air -= 1
            yield BoardView(board, False)


def in_sigmas(lens: Lens, found: LensCalibration) -> dict[float, float]:
    """At depths, mm: what the calibrated lens is off by over the face, in its own sigmas."""
    face = view_mm(DESIGN)
    rest, slope = lens.rays(lens.project_px(np.column_stack((face, np.zeros(len(face))))))
    out = {}
    for depth_mm, sigma_px in {0.0: found.face_px, **found.depth_px}.items():
        at = np.column_stack((rest - depth_mm * slope, np.full(len(face), -depth_mm)))
        off = np.linalg.norm(found.lens.project_px(at) - lens.project_px(at), axis=1)
        out[depth_mm] = float(np.percentile(off, 95)) / sigma_px
    return out


def require_honest(cases: Iterable[tuple[str, Lens, list[BoardView]]]) -> None:
    sigmas, refused, n = [], [], 0
    for name, lens, views in cases:
        n += 1
        try:
            found = lens_from_corners(views, lens.size_px, DESIGN)
        except InputError as why:
            refused.append(f"{name}: {why}")
            continue
        off = in_sigmas(lens, found)
        print(f"{name}: {', '.join(f'{s:.2f}' for s in off.values())} sigma; {found.depth_px}")
        sigmas += off.values()
    print("\n".join(refused))
    assert len(refused) <= n / 4
    assert np.mean(np.array(sigmas) <= 2) >= 0.95
    assert max(sigmas) <= 3


def test_other_lens_model_within_its_sigmas() -> None:
    lens = LENSES["seventh order -"]
    require_honest([("seventh order -", lens, list(seen(lens, 0, 0)))])


@pytest.mark.parametrize(
    "in_air", [pytest.param(0, marks=pytest.mark.slow), pytest.param(6, marks=pytest.mark.evidence)]
)
def test_lens_error_is_within_sigmas(in_air: int) -> None:
    require_honest(
        (f"{name}, {in_air} in air", lens, list(seen(lens, seed, in_air)))
        for seed, (name, lens) in enumerate(LENSES.items())
    )


def photographed(
    gradients: Iterable[tuple[str, float]],
) -> Iterator[tuple[str, Lens, list[BoardView]]]:
    """Pictures of the skin, through lenses by name and under light by edge to centre."""
    pictures: dict[str, NDArray[np.float64]] = {}
    for name, gradient in gradients:
        lens = LENSES[name]
        if name not in pictures:
            side_mm = SKIN.nx * SKIN.square_mm
            pictures = {name: Tracer(chessboard(SKIN.nx), side_mm, lens).light()}
        camera = Imaging(edge_to_centre=gradient, side=0.3)
        image = camera.develop(pictures[name], np.random.default_rng(1))
        found = find_corners(image, SKIN, f"{name} {gradient}")
        assert found is not None
        true = lens.project_px(np.column_stack((found.board_mm, np.zeros(len(found.px)))))
        off = np.linalg.norm(found.px - true, axis=1)
        assert np.percentile(off, 95) < 0.15
        assert len(off) > 340
        yield f"{name}, light {gradient}", lens, [BoardView(found, True)]


@pytest.mark.slow
def test_skin_found_under_led_light() -> None:
    pairs = zip(LENSES, (*GRADIENTS, 1.0), strict=True)
    require_honest(photographed(pairs))
