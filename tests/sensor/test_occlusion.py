"""What hides what in the view."""

from __future__ import annotations

import numpy as np

from deltact_fab.sensor.occlusion import folded_pixels, nearest_surface

ROWS, COLUMNS = 10, 40


def grid() -> np.ndarray:
    y, x = np.mgrid[:ROWS, :COLUMNS].astype(float)
    return np.stack((x, y), -1)


def shelf() -> np.ndarray:
    """The left half moved 8 px to the right, over the columns from 19 on."""
    at = grid()
    at[:, :20, 0] += 8
    return at


def test_unfolded_surface_has_no_folds() -> None:
    leaning = grid()
    leaning[..., 0] += 0.9 * np.sin(leaning[..., 0] / 2)
    assert not folded_pixels(grid(), (ROWS, COLUMNS)).any()
    assert not folded_pixels(leaning, (ROWS, COLUMNS)).any()


def test_nearer_surface_under_overhang_is_seen() -> None:
    at, y = shelf(), np.arange(ROWS)
    disputed = folded_pixels(at, (ROWS, COLUMNS))
    # Column 19 lies at x = 27 now and column 20 at x = 20: between them both are.
    assert (np.flatnonzero(disputed[5]) == np.arange(20, 28)).all()
    assert (disputed == disputed[5]).all()
    shelf_near = np.where(np.arange(COLUMNS) < 20, -1.0, 0.0) * np.ones((ROWS, 1))
    wanted = np.zeros_like(disputed)
    wanted[:, 24] = True
    assert np.allclose(nearest_surface(at, shelf_near, wanted), np.stack((16 + 0 * y, y), -1))
    assert np.allclose(nearest_surface(at, -shelf_near, wanted), np.stack((24 + 0 * y, y), -1))


def test_empty_pixel_is_nan() -> None:
    wanted = np.zeros((ROWS, COLUMNS), bool)
    wanted[3, 4] = wanted[3, 12] = True
    seen = nearest_surface(shelf(), np.zeros((ROWS, COLUMNS)), wanted)
    assert np.isnan(seen[0]).all()
    assert np.allclose(seen[1], (4, 3))
