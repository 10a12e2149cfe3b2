"""The fit of a lens to corners that are known exactly: what it finds, what it says of itself."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
from lenses import DESIGN, LIMITS_PX, SKIN, exact, lens_of, p95_px
from scipy.spatial.transform import Rotation

from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure.lens.calibration import (
    LensCalibration,
    calibrate_lens,
    lens_from_corners,
)
from deltact_fab.estimate.measure.lens.corners import find_corners
from deltact_fab.estimate.measure.lens.problem import BoardView
from deltact_fab.sensor.optics.checkerboard import Checkerboard
from deltact_fab.sensor.shapes.imaging import ImageSensor
from deltact_fab.simulate.virtual.photographs import ON_FACE, BoardPose, Studio

SIZE_PX = (1280, 720)
PLATE = Checkerboard(9, 7, 3.0)


def at(x: float, y: float, z: float = 0.0, tilt_x: float = 0.0, tilt_y: float = 0.0) -> BoardPose:
    return BoardPose((x, y, z), Rotation.from_euler("xyz", (tilt_x, tilt_y, 4.0), degrees=True))


WETTED = [at(0, 0), at(5, 4.5), at(-5, 4.5), at(5, -4.5), at(-5, -4.5)]
HELD = [at(1, 0, 8, 20, 5), at(-2, 1, 12, -15, 18), at(0, -2, 16, 5, -24), at(2, 2, 6, -8, -12)]


def fitted(*seen: BoardView) -> LensCalibration:
    return lens_from_corners(seen, SIZE_PX, DESIGN)


def check(found: LensCalibration, off: dict[float, float]) -> None:
    own = {0.0: found.face_px, **found.depth_px}
    for depth_mm, limit_px in LIMITS_PX.items():
        assert off[depth_mm] < limit_px
        assert off[depth_mm] < 2 * own[depth_mm]


def test_one_skin_image_calibrates_lens() -> None:
    true = lens_of(1)
    found = fitted(exact(true, SKIN, outliers=8))
    check(found, p95_px(found.lens, true))
    assert found.images[0]["outliers"] == 8
    assert found.noise_px == pytest.approx(0.05, rel=0.1)
    assert found.cover == 1
    # Off centre, turned and shifted as it was put together: the skin is the sensor's frame.
    assert found.lens.cx_px == pytest.approx(true.cx_px, abs=3 * found.sigma["cx_px"])
    assert found.lens.x0_mm == pytest.approx(true.x0_mm, abs=3 * found.sigma["x0_mm"])
    assert found.lens.roll_deg == pytest.approx(true.roll_deg, abs=0.01)
    # A thickness that no image tells is said, and keeps its prior's sigma.
    assert found.share["acrylic_mm"] > 0.9
    assert found.sigma["acrylic_mm"] == pytest.approx(0.05, rel=0.1)
    assert "acrylic_mm" in found.notes()[0]


@pytest.mark.slow
def test_wetted_and_air_boards_calibrate_lens() -> None:
    true = lens_of(2)
    touching = [exact(true, PLATE, p, seed=k, noise_px=0.03) for k, p in enumerate(WETTED)]
    held = [
        exact(true, PLATE, p, contact=False, seed=k, noise_px=0.03) for k, p in enumerate(HELD, 9)
    ]
    found = fitted(*touching, *held)
    check(found, p95_px(found.lens, true, aligned=True))
    assert (found.lens.x0_mm, found.lens.roll_deg) == (0, 0)
    assert "below the pupil" in " ".join(found.notes())


@pytest.mark.parametrize(
    ("seen", "says"),
    [
        ({"pose": at(0, 0), "board": PLATE}, "cover 6.% of the view .minimum 80%"),
        ({"board": Checkerboard(7, 5, 5.0, skin=True)}, r"of the face: 0.\d+ px, one sigma .limit"),
        ({"board": SKIN, "printed": (1.003, 1.0)}, "along y are 0.2.% shorter than along x"),
        ({"board": SKIN, "outliers": 70}, "board.png: corner residuals of 1.* px rms"),
        ({"board": SKIN, "noise_px": 0.3}, r"residuals of 0\.\d+ px rms .limit 0.25.: blurred"),
        ({"board": PLATE, "pose": at(0, 0, 6, 15), "contact": False}, "not flat on the face"),
    ],
    ids=["small", "coarse", "stretched", "misread", "noisy", "in-air"],
)
def test_uncertain_calibration_is_refused(seen: dict[str, object], says: str) -> None:
    wrong = exact(lens_of(1), **seen)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=says) as refused:
        # As the user says: they are all contact images.
        fitted(BoardView(wrong.corners, contact=True))
    assert "\n" not in str(refused.value)


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("skin", "air"), [(True, 0), (True, 9), (False, 9)], ids=["skin", "skin-and-air", "boards"]
)
def test_ten_lenses_from_rendered_images(skin: bool, air: int) -> None:
    """docs/evidence/lens.md has the table, which `pytest -s` prints: error / own sigma by depth."""
    # One image of the face does not tell air gap and law of the lens apart (decision 0019).
    limits_px = LIMITS_PX if air else {0.0: 0.1, 3.0: 1.0, 6.0: 2.5}
    for seed in range(10):
        true, rng = lens_of(seed), np.random.default_rng(seed)
        studio, board = Studio(true, ImageSensor(), DESIGN), SKIN if skin else PLATE
        poses = [ON_FACE] if skin else list(studio.contact_poses(PLATE, 5, rng))
        images = [(studio.photograph(board, p, rng), board, True) for p in poses]
        images += [(studio.photograph(PLATE, p, rng, contact=False), PLATE, False)
                   for p in studio.air_poses(PLATE, air, rng)]  # fmt: skip
        seen = []
        for image, board, contact in images:
            with suppress(InputError):  # a corner was not found: the photograph is taken again
                if (corners := find_corners(image, board, "image")) is not None:
                    seen.append(BoardView(corners, contact))
        assert len(seen) >= len(images) - 2
        found = fitted(*seen)
        off, own = p95_px(found.lens, true, not skin), {0.0: found.face_px, **found.depth_px}
        print(seed, " ".join(f"{off[d]:.3f}/{own[d]:.3f}" for d in off))
        assert all(off[d] <= min(limit, 2 * own[d]) for d, limit in limits_px.items()), seed


@pytest.mark.slow
def test_contact_image_as_air_is_refused() -> None:
    true = lens_of(0)
    wrong = exact(true, PLATE, at(1, 1))
    with pytest.raises(InputError, match=r"touches the face.*is it a contact image"):
        fitted(exact(true, SKIN), BoardView(wrong.corners, contact=False))


def test_boards_in_air_alone_are_refused() -> None:
    with pytest.raises(InputError, match=r"^no contact image: boards in air alone leave the face"):
        calibrate_lens([], PLATE, [])


@pytest.mark.parametrize("words", ["9x7", "9x7x0", "3x7x2", "9x7x3mm", "999x7x1"])
def test_invalid_board_is_refused(words: str) -> None:
    with pytest.raises(InputError, match="--board: "):
        Checkerboard.parse(words)
