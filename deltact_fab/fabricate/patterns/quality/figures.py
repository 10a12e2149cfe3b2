"""Figures of a pattern's image: texture to track, and risk of false matches.

They are taken from the grey image (ITU-R BT.601 luma), which the trackers follow. Mean intensity
gradient: Pan, Lu, Xie, Opt. Lasers Eng. 48 (2010) 469. SSSIG: Pan, Xie, Wang, Qian, Asundi, Opt.
Express 16 (2008) 7037. Both predict how image noise propagates into the error of a small
displacement. Contrast at the coarse levels of the pyramid tells whether a large one is found.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from deltact_fab.common import Array, Field

LUMA_WEIGHTS = (0.299, 0.587, 0.114)  # R, G, B by definition of ITU-R BT.601
SUBSET_PX = 15
"""Side of a subset, radius 7 as in the DIC codes of benchmarks/flow_peers.py."""
PYRAMID_LEVELS = 6  # by hand: level 5 of the smallest field has 2 pixels
LAGS_PER_PX = 4
"""Lags per camera pixel, by hand: whole pixels would miss the peak of a fine pattern."""
LOBE_EDGE = 0.1
"""Autocorrelation at which the main lobe ends, and least height of a peak; measured: the spline
rings to 0.07 around single-pixel noise."""
PEAK_SHARE = 0.8
"""Share of the highest peak. A regular pattern has a lattice of similar peaks, the nearest of which
is the likeliest false match; measured: 0.88 of the highest with patches of 2.6 camera pixels."""
PEAK_WITHIN = 0.25
"""Largest lag over the shorter side, by hand: beyond, overlap is small and noise dominates."""
SHIFT_PX = 2.0
"""Largest shift of a colour, by hand: more than misregistration of the inks causes."""


@dataclass(frozen=True)
class Figures:
    """Figures of one image; grey levels 0..255."""

    mean_gradient: float
    """Mean intensity gradient, grey levels per pixel."""
    sssig: float
    """Sum of squared gradients in a subset of 15 x 15 px, mean over x and y and subsets."""
    sssig_least: float
    """The same for the weakest subset; 0: nothing to track."""
    contrast: tuple[float, ...]
    """Standard deviation at pyramid levels 0..5, each half as large as the last (2 x 2 means)."""
    peak: float
    """Secondary peak of the autocorrelation: the nearest with 0.8 of the highest; 1: exact copy,
    0: none."""
    peak_mm: float | None
    """Its distance: a displacement near it can be mistaken for none. None: no peak."""


def figures(image: Array, mm_per_px: float) -> Figures:
    """Compute the figures of an image (h, w, 3), RGB 0..255; h, w at least 64."""
    shade = grey_levels(image)
    gx, gy = gradient(shade)
    height, peak_px = secondary_peak(autocorrelation(shade))
    weakest, mean = sssig(gx, gy)
    return Figures(
        mean_gradient=float(np.hypot(gx, gy).mean()),
        sssig=mean,
        sssig_least=weakest,
        contrast=contrast(shade),
        peak=height,
        peak_mm=None if peak_px is None else peak_px * mm_per_px,
    )


def grey_levels(image: Array) -> Field:
    """Luma of an RGB image (h, w, 3), float64."""
    red, green, blue = (image[..., c].astype(np.float64) for c in range(3))
    return LUMA_WEIGHTS[0] * red + LUMA_WEIGHTS[1] * green + LUMA_WEIGHTS[2] * blue


def gradient(shade: Field) -> tuple[Field, Field]:
    """Central differences (x, y) of an image (h, w), each (h - 2, w - 2)."""
    return ((shade[1:-1, 2:] - shade[1:-1, :-2]) / 2, (shade[2:, 1:-1] - shade[:-2, 1:-1]) / 2)


def sssig(gx: Field, gy: Field, side_px: int = SUBSET_PX) -> tuple[float, float]:
    """Least and mean sum of squared gradients over all subsets, mean of x and y."""
    sums = np.pad((gx**2 + gy**2) / 2, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    boxes = sums[side_px:, side_px:] - sums[:-side_px, side_px:]
    boxes -= sums[side_px:, :-side_px] - sums[:-side_px, :-side_px]
    return max(0.0, float(boxes.min())), float(boxes.mean())  # the sums round


def contrast(shade: Field) -> tuple[float, ...]:
    """Standard deviation at each level of the pyramid of 2 x 2 means."""
    out = []
    for level in range(PYRAMID_LEVELS):
        if level:
            rows, columns = (length // 2 * 2 for length in shade.shape)
            even = shade[:rows, :columns]
            shade = even.reshape(rows // 2, 2, columns // 2, 2).mean(axis=(1, 3))
        out.append(float(shade.std()))
    return tuple(out)


def autocorrelation(shade: Field) -> Field:
    """Normalised autocorrelation, (2k + 1, 2k + 1), lags -k..k, k a quarter of the shorter side.

    Each lag is divided by its overlap. A constant image has 1 at lag 0 and 0 elsewhere.
    """
    from scipy import fft

    reach = int(min(shade.shape) * PEAK_WITHIN)
    lags = np.arange(-reach, reach + 1)
    centred = shade - shade.mean()
    variance = float((centred**2).mean())
    if variance < 1e-12:
        return np.equal.outer(lags, -lags) * (lags == 0).astype(np.float64)
    size = [fft.next_fast_len(length + reach, real=True) for length in shade.shape]
    power = np.abs(fft.rfft2(centred, size)) ** 2
    overlap = np.outer(shade.shape[0] - np.abs(lags), shade.shape[1] - np.abs(lags))
    return np.asarray(fft.irfft2(power, size)[np.ix_(lags, lags)] / overlap / variance)


def secondary_peak(rho: Field) -> tuple[float, float | None]:
    """Height and distance (px) of the secondary peak of an `autocorrelation`.

    The nearest local maximum outside the main lobe that has PEAK_SHARE of the highest one; (0,
    None) when there is none. The main lobe is the region above LOBE that is connected to lag 0.
    Between whole lags rho is a spline of fifth order; a parabola refines the position.
    """
    from scipy import ndimage

    reach = len(rho) // 2 * LAGS_PER_PX
    rho = ndimage.zoom(rho, (2 * reach + 1) / len(rho), order=5)
    lobes, _ = ndimage.label(rho > LOBE_EDGE)
    # The outermost lags have no neighbours: a slope would pass for a maximum there
    inside = np.zeros(rho.shape, bool)
    inside[1:-1, 1:-1] = True
    inside &= lobes != lobes[reach, reach]
    inside &= (rho == ndimage.maximum_filter(rho, 3)) & (rho > LOBE_EDGE)
    if not inside.any():
        return 0.0, None
    tops = np.argwhere(inside)
    heights = rho[tops[:, 0], tops[:, 1]]
    tops = tops[heights >= PEAK_SHARE * heights.max()]
    row, column = min(tops.tolist(), key=lambda top: math.dist(top, (reach, reach)))
    vertex = (_vertex(rho[row - 1 : row + 2, column]), _vertex(rho[row, column - 1 : column + 2]))
    distance = math.hypot(row + vertex[0] - reach, column + vertex[1] - reach) / LAGS_PER_PX
    return float(min(rho[row, column], 1.0)), distance


def _vertex(values: Field) -> float:
    """Vertex of the parabola through values at -1, 0, 1; 0 for a plateau."""
    low, middle, high = (float(v) for v in values)
    curvature = low - 2 * middle + high
    return 0.0 if abs(curvature) < 1e-9 else max(-0.5, min(0.5, (low - high) / (2 * curvature)))


def agreement(image: Array, template: Array) -> float:
    """Correlation coefficient of two images (h, w) at the best shift of at most SHIFT_PX.

    The best has the largest magnitude, with its sign. 0 if either image is constant. Shifts are
    1/8 px apart, by Fourier interpolation, so that a displaced colour keeps its contrast.
    """
    from scipy import fft

    a, b = (np.asarray(v, np.float64) - np.mean(v, dtype=np.float64) for v in (image, template))
    spread = math.sqrt(float((a * a).mean() * (b * b).mean()))
    if spread < 1e-9:
        return 0.0
    rows, columns = a.shape
    cross = fft.fft2(a) * np.conj(fft.fft2(b))
    shifts = np.arange(-SHIFT_PX, SHIFT_PX + 1e-9, 1 / 8)
    down = np.exp(2j * np.pi * np.outer(shifts, np.fft.fftfreq(rows)))
    across = np.exp(2j * np.pi * np.outer(np.fft.fftfreq(columns), shifts))
    correlations = (down @ cross @ across).real / (rows * columns) ** 2
    best = float(correlations.flat[np.abs(correlations).argmax()])
    return max(-1.0, min(1.0, best / spread))
