"""A recipe's print in a camera's view beside the recipe: what it shows of place, light and film."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..aliases import Array, Field, Float, Image, Mask, Point, Point2
from ..cad.dimensions import Design
from ..errors import SensorError
from ..measure.face import FaceFlow
from ..measure.flow import FlowTracker
from ..measure.health import health
from ..measure.pipeline.measurement import Rectifier
from ..optics import CameraModel, FlatField
from ..patterns.locate import Placement
from ..shapes.imaging import GAMMA
from .print_in_view import RIM_PX, PrintInView, aligned, luma

LEAST_FRAMES = 10  # of which noise can be told
TILE_MM = 1.5
BLURS_PX = np.geomspace(0.25, 6.0, 20)
TILE_FOUND = 0.3  # correlation of a tile with the recipe
TILE_GAIN = 0.15  # contrast of a tile, of the median one
PLACE_MM, PLACE_SIGMA, PLACE_LEAST = 0.25, 7.0, 0.6  # the last is a share of the contrast
LEAST_PLACE_MM = 0.2
WIDE_MM = 2.0  # what differs alike over more is light


@dataclass(frozen=True)
class FaceFindings:
    """What images at rest show of a sensor, in mm of its frame.

    turned_deg: of the sticker from where the design has it, counter-clockwise as the camera sees
    it. scale: of the picture, over the camera's. keystone: by how much one side of the view is
    larger than the other. blur_px: standard deviation in each tile, rows of y, None where there is
    no pattern. level: of white, linear, 1 is full. evenness: least over mean; one_sided: by how
    much it falls from side to side, of its mean. edges: what of each side shows no pattern. torn,
    places: (x, y, length) of what lacks pattern at the rim, and of what lies before it. saturated:
    share of full pixels. noise_mm: of a point of the face; None: not known. rest: what `health`
    says against it.
    """

    agreement: float
    mirrored: bool
    turned_deg: float
    place_mm: Point2
    scale: float
    keystone: float
    blur_px: list[list[float | None]]
    level: float
    evenness: float
    one_sided: float
    face_share: float
    edges: dict[str, float]
    torn: tuple[Point, ...]
    places: tuple[Point, ...]
    saturated: float
    noise_mm: float | None
    rest: tuple[str, ...]


class StillImages:
    """The images at rest: their mean, what is full in them, the motion that the tracker sees."""

    def __init__(self, camera: CameraModel, flat: FlatField | None) -> None:
        self._camera, self._flat = camera, flat
        self._rectifier = Rectifier(camera)
        self._tracker = FlowTracker(full=False)
        self._sum: Field | None = None
        self._flows: list[Float] = []
        self._first: Image | None = None
        self.untrackable = ""
        self.count, self.saturated = 0, 0.0
        self.raw: Image = np.zeros((1, 1, 3), np.uint8)

    def add(self, raw: Image) -> None:
        """One more image (h, w, 3) BGR as the camera gives it."""
        seen = np.asarray(self._rectifier.view(raw), np.uint8)
        full = (raw.max(axis=2) >= 254).astype(np.uint8)
        maps = self._camera.maps()
        if maps is not None and seen is not raw:  # a cubic overshoots, and tells full ones wrongly
            full = cv2.remap(full, *maps, cv2.INTER_NEAREST)
        self.saturated = max(self.saturated, float(full.mean()))
        if self._sum is None:
            self._sum, self.raw = np.zeros(seen.shape), raw
        self._sum += seen
        self.count += 1
        even = seen if self._flat is None else self._flat.apply(seen)
        if not self.untrackable:
            try:
                flow = FaceFlow.of(self._tracker.update(even), self._camera, 8)
            except SensorError as why:
                self.untrackable = str(why)
                return
            self._flows.append(np.where(flow.known[..., None], flow.shift_mm, np.nan))
        if self._first is None:
            self._first = even
        self._last = even

    @property
    def mean(self) -> Float:
        """Of the images, as the camera's light has them (h, w, 3) BGR, 0..255."""
        assert self._sum is not None, "a source has an image, or it raises"
        return np.asarray(self._sum / self.count, np.float32)

    @property
    def noise_mm(self) -> float | None:
        """Noise of a point, median over the face; None of too few images, or untracked ones."""
        if self.count < LEAST_FRAMES:
            return None
        spread = np.hypot(*np.moveaxis(np.stack(self._flows[1:]).std(axis=0), -1, 0))
        known = np.isfinite(spread)
        return float(np.median(spread[known])) if known.any() else None

    @property
    def unrest(self) -> tuple[str, ...]:
        """What moved or changed from the first image to the last."""
        if self.untrackable:
            return (self.untrackable,)
        if self._first is None or self.count < 2:
            return ()
        return health(self._first, self._last, self._camera).reasons


class _Tiles:
    """Means over tiles of the view, and what they say of a drawn picture in a seen one."""

    def __init__(self, shape: tuple[int, ...], mm_per_px: float) -> None:
        self.ny, self.nx = (max(3, round(n * mm_per_px / TILE_MM)) for n in shape[:2])
        self._shape = shape
        self.mm = shape[1] * mm_per_px / self.nx, shape[0] * mm_per_px / self.ny
        x, y = ((np.arange(n) + 0.5 - n / 2) * side
                for n, side in zip((self.nx, self.ny), self.mm, strict=True))  # fmt: skip
        self.x_mm, self.y_mm = np.meshgrid(x, y)

    def mean(self, image: Array) -> Field:
        """(ny, nx)."""
        return np.asarray(
            cv2.resize(image, (self.nx, self.ny), interpolation=cv2.INTER_AREA), np.float64
        )

    def spread(self, values: Array) -> Float:
        """Values of tiles over the view's pixels."""
        size = (self._shape[1], self._shape[0])
        return np.asarray(cv2.resize(values.astype(np.float32), size), np.float32)

    def compared(self, seen: Float, drawn: Float) -> tuple[Field, ...]:
        """Correlation, slope and offset of seen over drawn, each (ny, nx)."""
        s, d = self.mean(seen), self.mean(drawn)
        ss, dd, sd = self.mean(seen * seen), self.mean(drawn * drawn), self.mean(seen * drawn)
        var_s, var_d = np.maximum(ss - s * s, 1e-9), np.maximum(dd - d * d, 1e-9)
        slope = (sd - s * d) / var_d
        return (sd - s * d) / np.sqrt(var_s * var_d), slope, s - slope * d


class ComparedPrint:
    """The recipe's print beside what is seen, at each of BLURS_PX: (blurs, ny, nx)."""

    def __init__(self, sticker: PrintInView, placement: Placement) -> None:
        self.seen, self.sticker, self.placement = luma(placement.image), sticker, placement
        self.tiles = tiles = _Tiles(self.seen.shape, sticker.camera.mm_per_px)
        self.drawn = aligned(self.seen, luma(sticker.seen(placement.to_px, RIM_PX)))
        self.blurred = [
            np.asarray(cv2.GaussianBlur(self.drawn, (0, 0), s), np.float32) for s in BLURS_PX
        ]
        self.like, self.slope, self.offset = (
            np.stack(one)
            for one in zip(*(tiles.compared(self.seen, b) for b in self.blurred), strict=True)
        )
        self.agreement = float(np.median(self.like.max(axis=0)))

    def findings(self, design: Design, still: StillImages) -> FaceFindings:
        camera, tiles, like = self.sticker.camera, self.tiles, self.like
        best = like.argmax(axis=0)
        # Contrast is compared at one blur: a tile without pattern may be like anything very soft.
        usual = self.slope[int(np.median(best))]
        shown = (like.max(axis=0) >= TILE_FOUND) & (usual >= TILE_GAIN * np.median(usual))
        slope, offset = (
            np.take_along_axis(one, best[None], 0)[0] for one in (self.slope, self.offset)
        )
        white = np.clip(slope + offset, 0, None) ** GAMMA
        light = _smooth(white, shown)[shown]
        mean = float(light.mean())
        edges, torn, inside = _missing(~shown, tiles)
        index = tiles.spread(_smooth(best, shown)).round().astype(int)
        slope_px, offset_px = (tiles.spread(_smooth(one, shown)) for one in (slope, offset))
        drawn = np.take_along_axis(np.stack(self.blurred), index[None], 0)[0]
        off, wide = self.seen - (drawn * slope_px + offset_px), round(WIDE_MM / camera.mm_per_px)
        off = np.abs(off - cv2.blur(off, (wide, wide)))
        off = off / np.maximum(slope_px, 1e-3) / self.drawn.std()
        marked = cv2.dilate((~shown & ~inside).astype(np.uint8), np.ones((5, 5), np.uint8))
        # A dot is white beside any ink: its edge depends on light and code, not on dirt.
        without = (tiles.spread(marked) > 0.5) | (self.sticker.dots(self.placement.to_px) > 0)
        way = np.linalg.inv(self.sticker.nominal) @ self.placement.to_px
        half = np.array([camera.width_px, camera.height_px]) * camera.mm_per_px / 2
        scale, keystone = _scales(way, half)
        turn = math.degrees(math.atan2(way[1, 1], way[0, 1])) - 90
        face_mm2 = design.skin.width_mm * design.skin.length_mm
        x_mm, y_mm = cv2.perspectiveTransform(np.zeros((1, 1, 2)), way)[0, 0].tolist()
        return FaceFindings(
            agreement=self.agreement,
            mirrored=self.placement.mirrored,
            turned_deg=(turn + 180) % 360 - 180,
            place_mm=(x_mm, y_mm),
            scale=scale,
            keystone=keystone,
            blur_px=[
                [round(float(b), 2) if there else None for b, there in zip(*row, strict=True)]
                for row in zip(_between(like, best), shown, strict=True)
            ],
            level=float(np.median(white[shown])),
            evenness=float(light.min()) / mean,
            one_sided=one_sided_fall(light / mean, tiles.x_mm[shown], tiles.y_mm[shown]),
            face_share=float(shown.mean() * 4 * half[0] * half[1] / face_mm2),
            edges=edges,
            torn=torn,
            places=_places(off, without, camera.mm_per_px),
            saturated=still.saturated,
            noise_mm=still.noise_mm,
            rest=still.unrest,
        )


def _between(like: Field, best: NDArray[np.int64]) -> Field:
    """The blur in px at the top of the parabola through the best of BLURS_PX and its neighbours."""
    at = np.clip(best, 1, len(BLURS_PX) - 2)
    below, top, above = (np.take_along_axis(like, (at + k)[None], 0)[0] for k in (-1, 0, 1))
    bend = below - 2 * top + above
    move = np.where(bend < 0, 0.5 * (below - above) / np.minimum(bend, -1e-12), 0.0)
    index = at + np.clip(move, -1, 1)
    return np.exp(np.interp(index, np.arange(len(BLURS_PX)), np.log(BLURS_PX)))


def _smooth(values: Array, known: Mask) -> Float:
    """Values of tiles, those that are not known as the nearest known one; medians of nine."""
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(cv2.medianBlur(values[tuple(nearest)].astype(np.float32), 3), np.float32)


def one_sided_fall(share: Array, x_mm: Array, y_mm: Array) -> float:
    """From one side of the view to the other, beside what falls off alike all round."""
    x, y = x_mm / np.abs(x_mm).max(), y_mm / np.abs(y_mm).max()
    table = np.stack((np.ones_like(x), x, y, x * x, y * y), axis=-1)
    fitted, *_ = np.linalg.lstsq(table, share, rcond=None)
    return float(2 * np.hypot(fitted[1], fitted[2]))


def _missing(missing: Mask, tiles: _Tiles) -> tuple[dict[str, float], tuple[Point, ...], Mask]:
    """Along whole sides, at the rim beside that, and which tiles lie inside."""
    depths, edges = [], {}
    for side, axis, flip in (("-x", 1, 1), ("+x", 1, -1), ("-y", 0, 1), ("+y", 0, -1)):
        lost = np.moveaxis(missing, axis, 0)[::flip].mean(axis=1) >= 0.5
        depths.append(int(np.argmin(np.append(lost, False))))
        if depths[-1]:
            edges[side] = round(depths[-1] * tiles.mm[1 - axis], 1)
    left = slice(depths[2], tiles.ny - depths[3]), slice(depths[0], tiles.nx - depths[1])
    count, labels = cv2.connectedComponents(missing[left].astype(np.uint8))
    rim = np.unique(np.concatenate((labels[[0, -1]].ravel(), labels[:, [0, -1]].ravel())))
    torn, inside = [], np.zeros_like(missing)
    for label in range(1, count):
        here = labels == label
        if label in rim:
            x, y = tiles.x_mm[left][here], tiles.y_mm[left][here]
            size = max(np.ptp(x) + tiles.mm[0], np.ptp(y) + tiles.mm[1])
            torn.append((round(float(x.mean()), 1), round(float(y.mean()), 1), round(size, 1)))
        else:
            inside[left] |= here
    return edges, tuple(torn), inside


def _places(off: Float, without: Mask, mm_per_px: float) -> tuple[Point, ...]:
    """Where the view is not what the pattern would be: middle and length, mm; the largest first."""
    size = max(3, round(PLACE_MM / mm_per_px))
    mean = cv2.blur(off, (size, size))
    usual = mean[~without]
    middle = float(np.median(usual))
    limit = middle + PLACE_SIGMA * 1.4826 * float(np.median(np.abs(usual - middle)))
    limit = max(limit, PLACE_LEAST)
    found = (mean > limit) & ~without
    joined = cv2.dilate(found.astype(np.uint8), np.ones((size, size), np.uint8))
    count, _, stats, middles = cv2.connectedComponentsWithStats(joined)
    h, w = off.shape
    places = []
    for k in range(1, count):
        x, y = (middles[k] - ((w - 1) / 2, (h - 1) / 2)) * mm_per_px
        longest = (
            max(stats[k, cv2.CC_STAT_WIDTH], stats[k, cv2.CC_STAT_HEIGHT]) - size
        ) * mm_per_px
        if longest >= LEAST_PLACE_MM:
            places.append((round(float(x), 1), round(float(y), 1), round(float(longest), 1)))
    return tuple(sorted(places, key=lambda place: -place[2]))


def _scales(way: Field, half_mm: Field) -> tuple[float, float]:
    """Of a map in the middle, and by how much one side's is larger than the other's, less 1."""

    def at(x: float, y: float) -> float:
        corners = np.array([[[x, y]], [[x + 0.1, y]], [[x, y + 0.1]]])
        a, b, c = cv2.perspectiveTransform(corners, way)[:, 0]
        return float(math.sqrt(abs(np.linalg.det(np.stack((b - a, c - a))))) / 0.1)

    x, y = half_mm
    ratios = [at(x, 0) / at(-x, 0), at(0, y) / at(0, -y)]
    return at(0, 0), max(max(r, 1 / r) for r in ratios) - 1
