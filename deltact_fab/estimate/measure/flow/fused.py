"""Dense inverse-compositional refinement of a flow, the reference prepared once.

A translation is fitted at every node, one node a cell of 2 x 2 pixels, over a window that falls to
half within 7 cells, in Lucas-Kanade steps on images of a quarter, a half and the full size (Baker
and Matthews 2004). Gradients, normal matrix and the correction of the linear warp (`nodes.phase`)
are the reference's, and gain and offset of the light are projected out. The sums also give the
local correlation and the deviation to be expected, before `denoise`.

The luma is tracked, blurred by sigma 1: a camera that subsamples chroma leaves luma whole, and the
blur takes the patterns of mosaic and compression away (decision 0061).
"""

from __future__ import annotations

from functools import lru_cache
from threading import get_ident
from typing import Any, NamedTuple

import cv2
import numpy as np

from deltact_fab.common import Array, InputError

from ..compose import shrink
from . import nodes
from .nodes import MIN_VARIANCE

MIN_SIDE_PX = 64  # by hand: below it the pyramids of every method degenerate
LEVEL_STEPS = (4, 3, 2)  # on a quarter, half and the full size; decision 0015
_N_LEVELS = 3  # decision 0015
COARSE_NODES = 2 ** (_N_LEVELS - 1)  # along a cell of the grid that a refinement starts on
_BEYOND_PX = 4  # exact: farthest pixel behind the last one that a warp reads
_EVEN_PX = 41  # of the half-size image; decision 0061
_EVEN_CONTRAST, _LEAST_CONTRAST = np.float32(40), np.float32(2)  # grey levels; by hand
_LIGHT_WINDOW = 11  # of 8 px; by hand: larger misses gradients, smaller follows the pattern
_PRIOR_WEIGHT = 0.02  # of the whole image; by hand: more flattens local light where little is shown
# Two steps pass 1.3 times the noise of one fit; the blur makes the noise of neighbours alike, so
# the fit leaves half of it or less (decision 0015).
NOISE_GAIN = 1.3 * 1.9


class SampledImage(NamedTuple):
    """Parts of a colour image that the anchored tracker reads.

    luma: (h, w) uint8, tracked channel. nodes: (hh, ww, 3) BGR uint8, one pixel per node of the
    half grid, hh = ceil(h / 2).
    """

    luma: Array
    nodes: Array

    @property
    def shape(self) -> tuple[int, int, int]:
        return (*self.luma.shape, 3)

    @property
    def ndim(self) -> int:
        return 3


def to_gray(image: Array) -> Array:
    """Convert BGR (h, w, 3) or grey (h, w) uint8 to a contiguous grey copy (h, w) uint8.

    Raises InputError for another type or shape.
    """
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)):
        raise InputError(
            f"image is {image.dtype} {image.shape}; (h, w, 3) BGR or (h, w) grey of uint8 is needed"
        )
    if image.ndim == 3:
        return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    # Kept across frames, while a camera may reuse its buffer.
    return np.array(image, order="C")


class Plane:
    """Tracked channel of one image with its pyramid, as a reference or as the image to match.

    gray: (h, w) uint8. small: (hh, ww) uint8, the same at half the size, a pixel per node, with
    local brightness and contrast equalized; input of `predict`.
    """

    def __init__(self, gray: Array) -> None:
        self.gray = gray
        h, w = gray.shape
        self.shape = (h, w)
        block = 2**_N_LEVELS
        level = cv2.copyMakeBorder(gray, 0, -h % block, 0, -w % block, cv2.BORDER_REPLICATE)
        self._levels = [level]
        for _ in range(1, _N_LEVELS):
            half = (level.shape[1] // 2, level.shape[0] // 2)
            level = cv2.resize(level, half, interpolation=cv2.INTER_AREA)
            self._levels.append(level)
        self.small = _equalize_contrast(self._levels[1][: -(-h // 2), : -(-w // 2)])

    @classmethod
    def from_image(cls, image: Array | SampledImage) -> Plane:
        """Convert (h, w) grey or (h, w, 3) BGR uint8 to its plane, which shares no memory with it.

        Raises InputError for another type or shape, and for sides below 64 px.
        """
        gray = to_gray(image.luma if isinstance(image, SampledImage) else image)
        if min(gray.shape) < MIN_SIDE_PX:
            raise InputError(
                f"flow: the image is {gray.shape}; sides of {MIN_SIDE_PX} px or more are needed"
            )
        return cls(cv2.GaussianBlur(gray, (0, 0), 1.0))

    def level(self, k: int) -> Array:
        """Return the image at 1 / 2^k of its size, padded to whole cells at every level."""
        return self._levels[k]

    def size_px(self, k: int) -> tuple[int, int]:
        """Return height and width of a level without its padding."""
        return self.shape[0] >> k, self.shape[1] >> k


class RefinedFlow(NamedTuple):
    """Result of a refinement at the nodes of the half grid, float32.

    flow_px: (hh, ww, 2), in px of the full image. correlation: (hh, ww) in -1..1, of the windows of
    reference and warped image; 0 if not visible in the current image. deviation_px: (hh, ww),
    standard deviation of the flow's endpoint by noise, wrong matches excluded. ahead_px2: (hh, ww),
    estimated remaining motion, squared: the last step over the contrast ratio of the current image
    to the reference.
    """

    flow_px: Array
    correlation: Array
    deviation_px: Array
    ahead_px2: Array


class _Level(NamedTuple):  # see `nodes`
    pixels: Array
    normal: Array
    phase: Array
    size_px: tuple[int, int]


class RefinementReference:
    """Precomputed reference of the refinement, from the plane of the reference image."""

    def __init__(self, plane: Plane) -> None:
        self.plane = plane
        self._levels = []
        for k in range(_N_LEVELS):
            image, size = plane.level(k), plane.size_px(k)
            parts = nodes.pixels(image), nodes.normal(image, size), nodes.phase(image)
            self._levels.append(_Level(*parts, size))

    def refine(self, current: Plane, start_px: Array | None = None) -> RefinedFlow:
        """Compute the flow from the reference to the current image, of the same size.

        start_px: (hh, ww, 2) float32 initial flow, or its means over COARSE_NODES x COARSE_NODES
        nodes (only these are used); `predict` by default. Correlation and deviation are those
        before the last step.
        """
        start = predict(self.plane, current) if start_px is None else start_px
        if start.shape[:2] == self.plane.small.shape:
            start = shrink(start, COARSE_NODES)
        planes = light = np.stack(cv2.split(start * np.float32(1 / COARSE_NODES)))
        n_rows, n_cols = (s // 2 for s in self.plane.level(0).shape)
        for k, n in zip(reversed(range(_N_LEVELS)), LEVEL_STEPS, strict=True):
            size = (n_cols >> k, n_rows >> k)
            planes = _resize(planes, size)
            # Grey levels are the same on every level: the first one's fit serves the next.
            between = 0 < k < _N_LEVELS - 1
            light = _resize(light, size, 1) if between else self._lighting(current, k, planes)
            target = _padded(current, k)
            for i in range(n):
                last = k == 0 and i == n - 1
                planes, quality = self._step(target, k, planes, light, last)
        return self._crop(cv2.merge(list(planes)), quality)

    def evaluate(self, current: Plane, flow_px: Array) -> RefinedFlow:
        """Compute correlation and deviation, as in `refine`, of a given flow (hh, ww, 2)."""
        (h, w), (hh, ww) = self.plane.level(0).shape, flow_px.shape[:2]
        padded = cv2.copyMakeBorder(flow_px, 0, h // 2 - hh, 0, w // 2 - ww, cv2.BORDER_REPLICATE)
        planes = np.stack(cv2.split(padded))
        light = self._lighting(current, 0, planes)
        return self._crop(flow_px, self._step(_padded(current, 0), 0, planes, light, True)[1])

    def _lighting(self, current: Plane, k: int, planes: Array) -> Array:
        """Fit the effect of changed light on reference less current image, see `kernel.step`.

        The fit uses the visible part of a window, one pixel of each 8 cells.
        """
        stride = 1 << (_N_LEVELS - 1 - k)
        height, width = self._levels[k].size_px
        start = planes[:, ::stride, ::stride]
        x0, y0 = (2 * stride * np.arange(n, dtype=np.float32) for n in start.shape[:0:-1])
        x, y = start[0] + x0, start[1] + y0[:, None]
        visible = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
        visible &= (x0 < width) & (y0[:, None] < height)
        grey = cv2.remap(current.level(k), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        r = self.plane.level(k)[:: 2 * stride, :: 2 * stride].astype(np.float32) - 128
        d = r + 128 - grey
        window = (_LIGHT_WINDOW, _LIGHT_WINDOW)
        sums = [visible * a for a in (np.ones_like(r), r, d, r * r, r * d)]
        # The mean of the whole image stabilises windows of which little is visible.
        n, r, d, rr, rd = (
            cv2.blur(a, window, borderType=cv2.BORDER_CONSTANT) + _PRIOR_WEIGHT * a.mean()
            for a in sums
        )
        n = np.maximum(n, _PRIOR_WEIGHT / r.size)
        slope = (n * rd - r * d) / np.maximum(n * rr - r * r, MIN_VARIANCE * n * n)
        coarse = np.stack([(d - slope * r) / n, slope])
        return _resize(coarse, (planes.shape[2], planes.shape[1]), 1)

    def _step(
        self, target: Array, k: int, planes: Array, light: Array, last: bool
    ) -> tuple[Array, Array]:
        from . import kernel  # imports numba, which is slow

        level, gain = self._levels[k], NOISE_GAIN if last else 0.0
        return kernel.step(target, *level, planes, light, gain)

    def _crop(self, flow: Array, quality: Array) -> RefinedFlow:
        hh, ww = self.plane.small.shape
        return RefinedFlow(*(np.ascontiguousarray(a[:hh, :ww]) for a in (flow, *quality)))


def _padded(plane: Plane, k: int) -> Array:
    """Return a level with the border that a step reads."""
    edge = cv2.BORDER_REPLICATE
    return cv2.copyMakeBorder(plane.level(k), 0, _BEYOND_PX, 0, _BEYOND_PX, edge)


def _resize(planes: Array, size: tuple[int, int], unit: float | None = None) -> Array:
    """Resample planes (2, rows, cols) to a grid of size (cols, rows).

    unit: factor on the values; by default the change of size, as for a flow in px of the grid.
    """
    if planes.shape[:0:-1] == size:
        return planes
    scale = size[0] / planes.shape[2]
    out = np.empty((2, size[1], size[0]), np.float32)
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    for plane, into in zip(planes, out, strict=True):
        cv2.resize(plane, size, into, interpolation=how)
    out *= np.float32(scale if unit is None else unit)
    return out


def _equalize_contrast(image: Array) -> Array:
    """Normalise an image (h, w) uint8 by its local mean and contrast, around 128: otherwise shading
    moves the DIS flow of a weak pattern."""
    fine = image.astype(np.float32)
    fine -= cv2.blur(fine, (_EVEN_PX, _EVEN_PX))
    power = cv2.blur(fine * fine, (_EVEN_PX, _EVEN_PX))
    fine *= _EVEN_CONTRAST / np.sqrt(np.maximum(power, _LEAST_CONTRAST**2))
    return np.clip(fine + 128, 0, 255).astype(np.uint8)


@lru_cache(maxsize=8)
def _dis(shape: tuple[int, int], thread: int) -> cv2.DISOpticalFlow:
    # One per size, as cv2 rewrites the settings of an instance that gets a small image; one per
    # thread, as it keeps its pyramids between calls.
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    dis.setFinestScale(2)
    dis.setGradientDescentIterations(25)
    dis.setVariationalRefinementIterations(2)
    return dis


def predict(a: Plane, b: Plane) -> Array:
    """Predict the flow between two images by DIS at half the size: (hh, ww, 2) float32 px."""
    start: Any = None
    dis = _dis(a.small.shape, get_ident())
    return np.asarray(dis.calc(a.small, b.small, start)) * np.float32(2)


def to_half(flow_px: Array) -> Array:
    """Convert a flow at pixels (h, w, 2) to nodes (hh, ww, 2) float32, hh = ceil(h / 2).

    A node is at the centre of its 2 x 2 pixels; a single last row or column is extrapolated.
    """
    h, w = flow_px.shape[:2]
    padded = np.asarray(flow_px, np.float32)
    if h % 2:
        padded = np.concatenate((padded, 2 * padded[-1:] - padded[-2:-1]), axis=0)
    if w % 2:
        padded = np.concatenate((padded, 2 * padded[:, -1:] - padded[:, -2:-1]), axis=1)
    size = (padded.shape[1] // 2, padded.shape[0] // 2)
    return np.asarray(cv2.resize(padded, size, interpolation=cv2.INTER_AREA))


def to_full(nodes_px: Array, shape: tuple[int, int]) -> Array:
    """Interpolate nodes (hh, ww[, c]) float32 at pixels (h, w[, c]); exact for linear fields."""
    hh, ww = nodes_px.shape[:2]
    padded = cv2.copyMakeBorder(nodes_px, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    for side in (padded.swapaxes(0, 1), padded):
        side[0], side[-1] = 2 * side[1] - side[2], 2 * side[-2] - side[-3]
    full = cv2.resize(padded, (2 * ww + 4, 2 * hh + 4), interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(full[2 : 2 + shape[0], 2 : 2 + shape[1]])
