"""Pixels and normal matrix of the reference image at each node, as input of a step."""

from __future__ import annotations

import cv2
import numpy as np

from deltact_fab.common import Array

# A box of 6 of a box of 5 of a box of 2: its transfer function is hardly negative; steps amplify
# negative parts (decision 0015).
WINDOW_WEIGHTS = np.array([1, 3, 5, 7, 9, 10, 9, 7, 5, 3, 1], np.float32)
# Definition: squared weight of independent pixel noise relative to one pixel.
OWN_WEIGHT = float(np.sum(WINDOW_WEIGHTS**2) ** 2 / np.sum(WINDOW_WEIGHTS) ** 2)
MIN_VARIANCE = 0.25  # grey levels^2; by hand: below the noise of a camera there is no texture
_SPECTRUM_PX = 63  # by hand: the waves of each place count alike, however strong
_GRADIENT_DAMPING = 0.01  # grey levels^2/px^2 per pixel; by hand: more slows steps on weak texture


def pixels(image: Array) -> Array:
    """Split cells into their four pixels, padded by one cell: (rows + 2, 4, cols + 2) float32."""
    padded = cv2.copyMakeBorder(image, 2, 2, 2, 2, cv2.BORDER_REPLICATE)
    out = np.empty((padded.shape[0] // 2, 4, padded.shape[1] // 2), np.float32)
    for k in range(4):
        out[:, k] = padded[k // 2 :: 2, k % 2 :: 2]
    out -= 128
    return out


def phase(image: Array) -> Array:
    """Compute the correction of a linear warp along x and y, (2, 2) float32.

    A linear warp by a fraction f of a pixel moves each wave by another one (Schreier et al. 2000).
    The fraction that moves the gradient by f is f + g (1 - 2 f) (c0 + c1 g), g = f (1 - f); c0 and
    c1 are those of the image, fitted at two f.
    """
    f = np.array([[0.1], [0.3]])
    g, out = f * (1 - f), []
    for side in (image, image.T):
        slope = np.diff(side.astype(np.float32))
        slope /= np.sqrt(cv2.blur(slope * slope, (_SPECTRUM_PX, _SPECTRUM_PX)) + MIN_VARIANCE)
        w = 2 * np.pi * np.fft.rfftfreq(slope.shape[1])[1:]
        power = np.sum(np.abs(np.fft.rfft(slope)[:, 1:]) ** 2, axis=0) / np.tan(w / 2) + 1e-9
        ahead, behind = (np.sin(w * part) @ power for part in (f, 1 - f))
        excess = (ahead / (ahead + behind) - f[:, 0]) / (g * (1 - 2 * f))[:, 0]
        out.append(np.linalg.solve(np.hstack((np.ones_like(g), g)), excess))
    return np.array(out, np.float32)


def normal(image: Array, size_px: tuple[int, int]) -> Array:
    """Compute normal matrix and light terms of each node's window, (rows, 10, cols) float32.

    size_px: height and width of the image without padding. Rows: three entries of the inverse;
    correction of a step for offset and gain of the light, x and y each; mean, power and weight of
    the window.
    """
    h, w = size_px
    gray = image.astype(np.float32) - 128
    gradients = (
        cv2.Sobel(gray, -1, dx, 1 - dx, ksize=1, scale=0.5, borderType=cv2.BORDER_REPLICATE)
        for dx in (1, 0)
    )
    inside = np.zeros([n // 2 for n in image.shape], np.float32)
    inside[: h // 2, : w // 2] = 1
    r, gx, gy = (
        np.stack([a[i::2, j::2] * inside for i in (0, 1) for j in (0, 1)])
        for a in (gray, *gradients)
    )

    def box(first: Array, second: Array) -> Array:
        return _around((first * second).sum(axis=0))

    n = np.maximum(_around(4 * inside), 1)
    mean = _around(r.sum(axis=0)) / n
    own_power = box(r, r) - n * mean**2
    power = np.maximum(own_power, n * MIN_VARIANCE)
    sx, sy = _around(gx.sum(axis=0)), _around(gy.sum(axis=0))
    kx, ky = box(gx, r) - mean * sx, box(gy, r) - mean * sy
    a11 = box(gx, gx) - sx * sx / n - kx * kx / power + _GRADIENT_DAMPING * n
    a12 = box(gx, gy) - sx * sy / n - kx * ky / power
    a22 = box(gy, gy) - sy * sy / n - ky * ky / power + _GRADIENT_DAMPING * n
    det = a11 * a22 - a12 * a12
    i11, i12, i22 = a22 / det, -a12 / det, a11 / det
    # A step is i (gx D - c D - k R D), summed: gain and offset are projected out of D.
    kx, ky = kx / power, ky / power
    cx, cy = sx / n - kx * mean, sy / n - ky * mean
    nodes = [
        i11, i12, i22,
        i11 * cx + i12 * cy, i12 * cx + i22 * cy, i11 * kx + i12 * ky, i12 * kx + i22 * ky,
        mean, own_power, n,
    ]  # fmt: skip
    return np.stack(nodes, axis=1)


def _around(cells: Array) -> Array:
    """Weighted sums over the window, zero outside the image."""
    w = WINDOW_WEIGHTS
    return np.asarray(cv2.sepFilter2D(cells, -1, w, w, borderType=cv2.BORDER_CONSTANT))
