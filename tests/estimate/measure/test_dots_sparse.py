"""Dots without colours around them: identities from the neighbours, layouts of any kind."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from deltact_fab.common.errors import InputError, SensorError
from deltact_fab.estimate.measure.dots import identity
from deltact_fab.estimate.measure.dots import tracker as tracking
from deltact_fab.estimate.measure.dots.detect import find_dots
from deltact_fab.estimate.measure.dots.tracker import DotTracker

MM_PER_PX = 0.0378
W, H = 798, 586
ROWS, COLUMNS = np.mgrid[0:H, 0:W]


def grid(pitch_mm: tuple[float, float], columns: int, rows: int) -> Any:
    """(n, 2) px about the middle of the view."""
    x = (np.arange(columns) - (columns - 1) / 2) * pitch_mm[0] / MM_PER_PX + (W - 1) / 2
    y = (np.arange(rows) - (rows - 1) / 2) * pitch_mm[1] / MM_PER_PX + (H - 1) / 2
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


def picture(
    centres: Any, diameter_mm: float, seed: int = 0, ink: float = 25, ground: float = 225
) -> Any:
    """BGR uint8 discs on an even ground in uneven light, with noise."""
    radius = diameter_mm / 2 / MM_PER_PX
    image = np.full((H, W), float(ground))
    n = int(radius) + 3
    for px, py in centres[np.isfinite(centres[:, 0])]:
        left, top = int(px) - n, int(py) - n
        box = np.s_[max(0, top) : max(0, top + 2 * n), max(0, left) : max(0, left + 2 * n)]
        y, x = ROWS[box], COLUMNS[box]
        cover = np.clip(radius + 0.5 - np.hypot(x - px, y - py), 0, 1)
        image[box] += (ink - ground) * cover
    image *= np.linspace(1.0, 0.65, W)
    image += np.random.default_rng(seed).normal(0, 2, image.shape)
    return np.repeat(np.clip(np.round(image), 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def visible(centres: Any, border: float = 14.0) -> Any:
    return ((centres > border) & (centres < [W - border, H - border])).all(1)


def apart(centres: Any, diameter_mm: float) -> Any:
    """Discs that touch, where the skin is squeezed, are one blob."""
    return cKDTree(centres).query(centres, 2)[0][:, 1] * MM_PER_PX > 1.3 * diameter_mm


def errors_mm(seen: Any, moved: Any) -> Any:
    return np.hypot(*(seen.displacement_px - moved)[seen.located].T) * MM_PER_PX


# Layout, diameter in mm, mm a frame: less than a pitch, at which a regular grid repeats itself
LAYOUTS = {
    "1 mm": (grid((1.0, 1.0), 28, 20), 0.4, 0.5),
    "1.6 mm": (grid((1.6, 1.6), 17, 13), 0.5, 1.0),
}


@pytest.fixture
def round_discs(monkeypatch):
    """The discs stay round while the skin stretches: their areas tell nothing."""
    for module in (identity, tracking):
        monkeypatch.setattr(module, "MAX_AREA_FACTOR", 4.0)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_10_mm_of_shear_swaps_none(layout, make_bump, round_discs):
    rest, diameter_mm, step_mm = LAYOUTS[layout]
    bump = make_bump((330, 300), 215, shear_px=(10 / MM_PER_PX, 0.0))
    tracker = DotTracker(rest, diameter_mm / MM_PER_PX, polarity="dark")
    tracker.update(picture(rest, diameter_mm))
    n = round(10 / step_mm)
    for k in range(1, n + 1):
        moved = bump.scaled(k / n).displacement_px(rest)
        seen = tracker.update(picture(rest + moved, diameter_mm, k))
        assert errors_mm(seen, moved).max() <= 0.1
        assert errors_mm(seen, moved).mean() <= 0.005
        assert seen.located[visible(rest + moved) & apart(rest + moved, diameter_mm)].all()
        # On a close layout the rings reach the next dots, which look alike everywhere
        assert np.isnan(seen.identity_ncc).all()
    assert np.hypot(*moved.T).max() * MM_PER_PX > 9


@pytest.mark.slow
@pytest.mark.parametrize("seed", [21, 22])
def test_large_shear_with_dropouts_and_specks(seed, make_bump, round_discs):
    rest = grid((2.2, 1.6), 13, 13)
    rng = np.random.default_rng(seed)
    bump = make_bump((330, 300), 215, shear_px=(10 / MM_PER_PX, 0.0))
    tracker = DotTracker(rest, 0.5 / MM_PER_PX, polarity="dark")
    tracker.update(picture(rest, 0.5))
    wrong = lost = seen_at_all = 0
    for k, s in enumerate([*np.linspace(0, 1, 21)[1:], *np.linspace(1, 0, 21)[1:]]):
        moved = bump.scaled(float(s)).displacement_px(rest)
        now = rest + moved
        now[rng.random(len(rest)) < 0.02] = np.nan
        specks = rng.uniform([20, 20], [W - 20, H - 20], (3, 2))
        seen = tracker.update(picture(np.concatenate((now, specks)), 0.5, k))
        shown = visible(now) & apart(rest + moved, 0.5)
        wrong += int((errors_mm(seen, moved) > 0.3).sum())
        lost += int((shown & ~seen.located).sum())
        seen_at_all += int(shown.sum())
    assert wrong == 0
    assert lost <= 0.002 * seen_at_all
    print(f"{wrong} wrong, {lost} lost of {seen_at_all}")


def test_irregular_layout_is_tracked(make_bump):
    rest = grid((1.9, 1.7), 12, 11)
    rest += np.random.default_rng(3).uniform(-9, 9, rest.shape)
    tracker = DotTracker.from_image(picture(rest, 0.5))
    assert tracker.polarity == "dark"
    assert len(tracker.rest_px) == len(rest)
    assert tracker.diameter_px == pytest.approx(0.5 / MM_PER_PX, rel=0.15)
    which = [int(np.argmin(np.hypot(*(rest - at).T))) for at in tracker.rest_px]
    assert sorted(which) == list(range(len(rest)))
    bump = make_bump((400, 290), 160, shear_px=(90, 40), press_px=20)
    assert tracker.update(picture(rest, 0.5)).located.all()
    for k in range(1, 7):
        moved = bump.scaled(k / 6).displacement_px(rest)
        seen = tracker.update(picture(rest + moved, 0.5, k))
        assert errors_mm(seen, moved[which]).max() <= 0.1
        assert seen.located.mean() >= 0.97


def test_left_and_hidden_dots_return():
    rest = grid((2.2, 1.6), 13, 13)
    tracker = DotTracker(rest, 0.6 / MM_PER_PX, polarity="dark")
    tracker.update(picture(rest, 0.6))
    for k, s in enumerate([*np.linspace(0, 1, 21)[1:], *np.linspace(1, 0, 21)[1:]], 1):
        moved = np.tile([s * 200.0, 0.0], (len(rest), 1))
        now = rest + moved
        if 8 <= k <= 30:
            now[np.hypot(*(rest - rest[70]).T) < 90] = np.nan
        seen = tracker.update(picture(now, 0.6, k))
        assert not seen.located[np.isnan(now[:, 0])].any()
        assert errors_mm(seen, moved).max() <= 0.06
    assert seen.located.all()


def test_short_glitch_survived_long_gap_lost():
    rest = grid((2.2, 1.6), 13, 13)
    first = picture(rest, 0.6)
    moved = picture(rest + [11.0, -9.0], 0.6, 3)
    blank = np.zeros((H, W, 3), np.uint8)
    for frames in (1, 4):
        tracker = DotTracker(rest, 0.6 / MM_PER_PX, polarity="dark")
        tracker.update(first)
        for _ in range(frames):
            assert not tracker.update(blank).located.any()
        seen = tracker.update(moved)
        # A grid that nobody watched for a while may stand a pitch further on
        assert seen.located.all() if frames == 1 else not seen.located.any()
        shift = np.tile([11.0, -9.0], (169, 1))
        assert not seen.located.any() or errors_mm(seen, shift).max() < 0.06


def test_sudden_release_is_tracked(make_bump):
    rest = grid((2.2, 1.6), 13, 13)
    bump = make_bump((400, 290), 170, shear_px=(110, 0))
    tracker = DotTracker(rest, 0.6 / MM_PER_PX, polarity="dark")
    tracker.update(picture(rest, 0.6))
    for k in range(1, 7):
        tracker.update(picture(rest + bump.scaled(k / 6).displacement_px(rest), 0.6, k))
    seen = tracker.update(picture(rest, 0.6, 9))
    assert seen.located.all()
    assert np.hypot(*seen.displacement_px.T).max() * MM_PER_PX <= 0.03


def test_an_image_without_dots_is_refused(make_scene):
    noise = np.random.default_rng(1).integers(0, 256, (H, W, 3), np.uint8)
    dense = make_scene(W, H, patch_mm=0.1).picture()
    for image in (noise, dense, *(np.full((H, W, 3), value, np.uint8) for value in (0, 128, 255))):
        with pytest.raises(SensorError, match="fewer than 9 white or dark dots of one size"):
            find_dots(image)
    with pytest.raises(InputError, match="BGR uint8"):
        find_dots(dense[..., 0])


@pytest.mark.parametrize(("turn_deg", "square_px"), [(0, 53), (20, 26), (45, 14)])
def test_a_chessboard_is_not_dots(turn_deg, square_px):
    c, s = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    u, v = c * COLUMNS + s * ROWS, c * ROWS - s * COLUMNS
    board = ((u // square_px + v // square_px) % 2 * 200 + 20).astype(np.uint8)
    board = cv2.GaussianBlur(board, (0, 0), 1.5)
    with pytest.raises(SensorError, match="dots: the image"):
        find_dots(np.repeat(board[..., None], 3, axis=2))


def test_white_dots_among_colours_found(make_scene):
    scene = make_scene(W, H, dots=True)
    dots = find_dots(scene.picture())
    assert (dots.polarity, len(dots.position_px)) == ("white", 169)
    assert dots.diameter_px == pytest.approx(0.6 / MM_PER_PX, rel=0.15)
    assert dots.pitch_px == pytest.approx(1.6 / MM_PER_PX, rel=0.02)


def test_neighbour_order_kept_without_colours():
    rest = grid((2.2, 1.6), 7, 7)

    def picture_of(at):
        return picture(at, 0.6, ink=240, ground=90)

    tracker = DotTracker(rest, 0.6 / MM_PER_PX)
    first = tracker.update(picture_of(rest))
    assert first.located.all()
    assert np.isnan(first.identity_ncc).all()
    assert np.abs((first.position_px - rest).mean(axis=0)).max() < 0.1
    moved = tracker.update(picture_of(rest + np.array([6.0, -4.0])))
    assert moved.located.all()
    assert moved.displacement_px == pytest.approx(np.tile([6.0, -4.0], (49, 1)), abs=0.1)
    # Two neighbours walk around each other, which no skin can do: following each by nearness
    # would report an exchange as a motion of one pitch.
    tracker = DotTracker(rest, 0.6 / MM_PER_PX)
    tracker.update(picture_of(rest))
    a, b = 24, 31
    middle, half = (rest[a] + rest[b]) / 2, (rest[a] - rest[b]) / 2
    for angle in np.linspace(0, np.pi, 19)[1:]:
        c, s = np.cos(angle), np.sin(angle)
        arm = np.array([c * half[0] - s * half[1], s * half[0] + c * half[1]])
        now = rest.copy()
        now[a], now[b] = middle + arm, middle - arm
        seen = tracker.update(picture_of(now))
    for dot in (a, b):
        assert not seen.located[dot] or np.hypot(*seen.displacement_px[dot]) < 2.0
    others = np.delete(np.arange(49), [a, b])
    assert np.hypot(*seen.displacement_px[others][seen.located[others]].T).max() < 1.0
