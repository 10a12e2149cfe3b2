"""What a step needs of the reference image at each node: its pixels and its normal matrix."""

from __future__ import annotations

import cv2
import numpy as np

from deltact_fab.common import Array

# A box of 6 of a box of 5 of a box of 2: its transfer function has hardly a negative part, which
# steps would amplify.
WINDOW = np.array([1, 3, 5, 7, 9, 10, 9, 7, 5, 3, 1], np.float32)
# Independent noise in the pixels weighs so much more, squared, than one pixel does.
OWN_WEIGHT = float(np.sum(WINDOW**2) ** 2 / np.sum(WINDOW) ** 2)
MIN_VARIANCE = 0.25  # grey levels^2: less is no texture
_DAMPING = 0.01  # grey levels^2 / px^2 a pixel, on the normal matrix


def pixels(image: Array) -> Array:
    """A cell's four pixels apart, a cell more on each side: (rows + 2, 4, cols + 2) float32."""
    padded = cv2.copyMakeBorder(image, 2, 2, 2, 2, cv2.BORDER_REPLICATE)
    out = np.empty((padded.shape[0] // 2, 4, padded.shape[1] // 2), np.float32)
    for k in range(4):
        out[:, k] = padded[k // 2 :: 2, k % 2 :: 2]
    out -= 128
    return out


def normal(image: Array, size_px: tuple[int, int]) -> Array:
    """Normal matrix and light of each node's window, (rows, 10, cols) float32.

    size_px: height and width of the image within its padding. The inverse's three entries; what the
    offset and the gain of the light take from a step, x and y each; mean, power and weight of the
    window.
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
    power = np.maximum(box(r, r) - n * mean**2, n * MIN_VARIANCE)
    sx, sy = _around(gx.sum(axis=0)), _around(gy.sum(axis=0))
    kx, ky = box(gx, r) - mean * sx, box(gy, r) - mean * sy
    a11 = box(gx, gx) - sx * sx / n - kx * kx / power + _DAMPING * n
    a12 = box(gx, gy) - sx * sy / n - kx * ky / power
    a22 = box(gy, gy) - sy * sy / n - ky * ky / power + _DAMPING * n
    det = a11 * a22 - a12 * a12
    i11, i12, i22 = a22 / det, -a12 / det, a11 / det
    # A step is i (gx D - c D - k R D), summed: gain and offset are projected out of D.
    kx, ky = kx / power, ky / power
    cx, cy = sx / n - kx * mean, sy / n - ky * mean
    nodes = [
        i11, i12, i22,
        i11 * cx + i12 * cy, i12 * cx + i22 * cy, i11 * kx + i12 * ky, i12 * kx + i22 * ky,
        mean, power, n,
    ]  # fmt: skip
    return np.stack(nodes, axis=1)


def _around(cells: Array) -> Array:
    """Weighted sums over the window, with nothing outside."""
    return np.asarray(cv2.sepFilter2D(cells, -1, WINDOW, WINDOW, borderType=cv2.BORDER_CONSTANT))
