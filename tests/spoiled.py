"""Prints and scans gone wrong, by Pillow and scipy alone: nothing of the product is used here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage

PAPER = 247.0


def print_of(
    page: np.ndarray,
    *,
    scale: tuple[float, float] = (1.0, 1.0),
    shear: float = 0.0,
    turn_deg: float = 0.0,
    blur_px: float = 0.6,
    inks_px: tuple[tuple[float, float], ...] = ((0.0, 0.0),) * 3,
    fade: tuple[float, float, float] = (1.0, 1.0, 1.0),
    streaks: tuple[slice, ...] = (),
    mirrored: bool = False,
    noise: float = 2.0,
    seed: int = 0,
) -> np.ndarray:
    """A page (h, w, 3) uint8 as it comes off a printer and a scanner of the same resolution.

    scale in x and y and shear (x by y) about its middle, then a turn; inks: shifts (x, y) of R, G,
    B; fade: what is left of each one's ink; streaks: rows that have no ink.
    """
    source = page[:, ::-1] if mirrored else page
    ink = (255.0 - source.astype(float)) * np.array(fade)
    for rows in streaks:
        ink[rows] = 0
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    # Rows and columns, as scipy counts: from the scan back to the page.
    move = np.array([[c, -s], [s, c]]) @ np.array([[scale[1], 0.0], [shear, scale[0]]])
    back = np.linalg.inv(move)
    middle = (np.array(page.shape[:2]) - 1) / 2
    scan = np.empty_like(ink)
    for k in range(3):
        x, y = inks_px[k]
        one = ndimage.gaussian_filter(ink[..., k], blur_px)
        off = middle - back @ (middle + (y, x))
        scan[..., k] = PAPER - ndimage.affine_transform(one, back, off, order=1) * PAPER / 255
    rng = np.random.default_rng(seed)
    return np.clip(scan + rng.normal(0, noise, scan.shape), 0, 255).astype(np.uint8)


def photograph_of(scan: np.ndarray, corners_px: tuple[tuple[float, float], ...]) -> np.ndarray:
    """A hand-held photograph: the scan's corners (x, y) as they go round lie there."""
    h, w = scan.shape[:2]
    rows = []
    for (x, y), (u, v) in zip(corners_px, ((0, 0), (w, 0), (w, h), (0, h)), strict=True):
        rows.append([x, y, 1, 0, 0, 0, -u * x, -u * y, u])
        rows.append([0, 0, 0, x, y, 1, -v * x, -v * y, v])
    table = np.array(rows)
    eight = np.linalg.solve(table[:, :8], table[:, 8])
    size = (int(max(x for x, _ in corners_px)), int(max(y for _, y in corners_px)))
    seen = Image.fromarray(scan).transform(
        size, Image.Transform.PERSPECTIVE, eight.tolist(), Image.Resampling.BICUBIC,
        fillcolor=(120, 110, 100),
    )  # fmt: skip
    return np.asarray(seen)


def save(image: np.ndarray, path: Path, dpi: float | None = None, quality: int = 90) -> Path:
    """As JPEG, or by the name's ending, with its resolution."""
    more = {} if dpi is None else {"dpi": (dpi, dpi)}
    Image.fromarray(image).save(path, quality=quality, **more)
    return path
