"""White dots inside the colour pattern: sub-pixel centroids with identities kept over the frames.

The paper (Pattern Selection) separates the white dots by a colour filter and measures their
displacement by blob detection, as the truth that optical flow is compared with. Here: whiteness =
min(B, G, R) over the local light, blurred so that single white patches vanish; connected
components; centroids weighted by the whiteness above the threshold, so that a pixel at the contour
weighs nothing and none flips in or out.

Identity is not taken from nearness alone. A regular grid looks the same after a shift by one
pitch, but the random colours around each dot do not: a ring of them is sampled, deformed by the
local affine motion of the neighbours, and must correlate with the ring of the first image.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, SensorError
from .compose import sample

Array = NDArray[Any]


@dataclass(frozen=True)
class DotRule:
    """Limits of the dot tracker; lengths in dot diameters (d) or pitches.

    blur_d: sigma of the blur of the whiteness. level: where between the background and the dots
    the contour is cut. area_factor: a dot's area against what the neighbours' motion predicts may
    differ by this factor; beyond, it is partly covered or merged. gate_pitch: how far from its
    prediction a dot is looked for. ncc_min: identity of the ring of colours. ncc_found: the same
    for a dot found again anywhere in the image. ring_d: inner and outer radius of the ring.
    min_texture: standard deviation (grey levels) of the ring below which a pattern has no colours
    to identify dots by, and only the order of the neighbours is checked.
    """

    blur_d: float = 0.15
    level: float = 0.5
    area_factor: float = 1.7
    gate_pitch: float = 0.45
    ncc_min: float = 0.5
    ncc_found: float = 0.65
    ring_d: tuple[float, float] = (0.75, 1.5)
    min_texture: float = 2.0
    min_found_share: float = 0.5


@dataclass(frozen=True)
class DotObservation:
    """The dots of one frame; every array is in the order of the rest positions.

    position_px: (n, 2) float64, NaN where lost. displacement_px: (n, 2), position - first position.
    found: (n,) bool. identity_ncc: (n,) correlation of the ring of colours with the first image,
    NaN where lost or where the pattern has no colours. n_blobs: white blobs of the size of a dot.
    n_rejected: dots matched by position and refused by area, order or identity. cpu_ms: process
    time of the update.
    """

    position_px: Array
    displacement_px: Array
    found: Array
    identity_ncc: Array
    n_blobs: int
    n_rejected: int
    cpu_ms: float


class DotTracker:
    """Follow white dots from their first image on.

    rest_px: (n, 2) expected positions (x, y) in the first image, right to within `offset_px` after
    a common shift of as much; diameter_px: the dots' diameter. n >= 4 dots, not on a line.
    On a pattern without colours around the dots, dots that are all lost at once stay lost: nothing
    tells the grid from itself one pitch on. Raises InputError for anything else.
    """

    def __init__(
        self,
        rest_px: Array,
        diameter_px: float,
        *,
        offset_px: float = 8.0,
        rule: DotRule | None = None,
    ) -> None:
        rest = np.asarray(rest_px, dtype=np.float64)
        if rest.ndim != 2 or rest.shape[1] != 2 or len(rest) < 4 or not np.isfinite(rest).all():
            raise InputError(
                f"dots: rest_px is {rest.shape}; (n, 2) finite positions of n >= 4 dots are needed"
            )
        if not (np.isfinite(diameter_px) and diameter_px >= 4):
            raise InputError(
                f"dots: diameter_px is {diameter_px}; at least 4 px are needed for a centroid"
            )
        if np.linalg.matrix_rank(rest - rest.mean(0), tol=diameter_px) < 2:
            raise InputError("dots: all rest positions lie on one line")
        self.rule = rule or DotRule()
        self.rest_px = rest
        self.diameter_px = float(diameter_px)
        self._nominal_area = np.pi / 4 * self.diameter_px**2
        distance = _distances(rest, rest)
        np.fill_diagonal(distance, np.inf)
        self.pitch_px = float(distance.min())
        if self.pitch_px < 1.3 * diameter_px:
            raise InputError(
                f"dots: two rest positions are {self.pitch_px:.1f} px apart; "
                f"dots of {diameter_px:.1f} px need at least 1.3 diameters"
            )
        self.offset_px = min(float(offset_px), self.rule.gate_pitch * self.pitch_px)
        count = min(8, len(rest) - 1)
        self._near = np.argsort(distance, axis=1, kind="stable")[:, :count]
        self._triangles = _triangles(rest)
        inner, outer = self.rule.ring_d
        # The ring must end before the next dot does start, also when the pitch is small.
        outer = min(outer * diameter_px, self.pitch_px - 0.6 * diameter_px)
        radii = np.arange(min(inner * diameter_px, outer), outer + 1e-9, 2.0)
        self._ring = np.concatenate(
            [
                r * np.stack((np.cos(a), np.sin(a)), -1)
                for r in radii
                for a in [np.arange(int(np.pi * r)) * (2 * np.pi / int(np.pi * r))]
            ]
        )
        # Orthonormal basis of 1, x, y on the ring.
        self._plane = np.linalg.qr(np.column_stack((np.ones(len(self._ring)), self._ring)))[0]
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next image is the first."""
        self._shape: tuple[int, ...] | None = None
        self._first = np.full_like(self.rest_px, np.nan)
        self._last = self._first.copy()
        self._seen = self._first.copy()
        self._started = False
        self._motion = np.zeros_like(self.rest_px)
        self._areas = np.full(len(self.rest_px), self._nominal_area)
        self._level = 0.0
        self._rings: Array | None = None

    @property
    def first_px(self) -> Array:
        """(n, 2) positions in the first image, NaN for dots not found in it."""
        return self._first.copy()

    def update(self, image: Array) -> DotObservation:
        """Find the dots in one more image, (h, w, 3) BGR uint8 of the first image's size.

        Raises InputError for another type or size, SensorError when the first image does not show
        at least min_found_share of the dots.
        """
        start_s = time.process_time()
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            raise InputError(f"dots: image is {image.dtype} {image.shape}; BGR uint8 is needed")
        if self._shape is not None and image.shape != self._shape:
            raise InputError(f"dots: the image is {image.shape}, the first one was {self._shape}")
        white = self._whiteness(image)
        # Colours are compared at the scale of a patch, not of a pixel.
        colours = cv2.GaussianBlur(image, (0, 0), 1.5)
        if self._shape is None:
            return self._register(image, white, colours, start_s)
        blobs, area = self._blobs(white, self._level)
        position, ncc, n_rejected = self._follow(blobs, area, colours)
        found = np.isfinite(position[:, 0])
        ncc[~found] = np.nan
        return self._observe(position, found, ncc, len(blobs), n_rejected, start_s)

    # First image

    def _register(
        self, image: Array, white: Array, colours: Array, start_s: float
    ) -> DotObservation:
        h, w = white.shape
        reach = int(np.ceil(self.offset_px))
        rest = self.rest_px
        seen = (rest >= 0).all(1) & (rest[:, 0] <= w - 1) & (rest[:, 1] <= h - 1)
        if not seen.any():
            raise InputError(f"dots: no expected position lies in the image of {w} x {h} px")
        peaks = [
            white[max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1].max()
            for x, y in np.round(rest[seen]).astype(int)
        ]
        background = float(np.median(white))
        self._level = background + self.rule.level * (float(np.median(peaks)) - background)
        blobs, area = self._blobs(white, self._level)
        position = np.full_like(rest, np.nan)
        shift = np.zeros(2)
        # A common offset first, then each dot within the same tolerance of it.
        for _ in range(2):
            have = np.isfinite(position[:, 0])
            if have.any():
                shift = np.median((position - rest)[have], axis=0)
            position[:] = np.nan
            if not len(blobs):
                break
            who, which = _mutual(rest + shift, blobs, np.full(len(rest), self.offset_px))
            position[who] = blobs[which]
            self._keep_area(position, area, who, which, np.ones(len(rest)))
        found = np.isfinite(position[:, 0])
        if found.sum() < max(4, self.rule.min_found_share * len(rest)):
            n = int(found.sum())
            self.reset()
            raise SensorError(
                f"dots: {n} of {len(rest)} white dots found in the first image; at least "
                f"{int(np.ceil(max(4, self.rule.min_found_share * len(rest))))} are needed: "
                "wrong pattern, out of focus, over-exposed, or shifted by more than "
                f"{self.offset_px:.0f} px"
            )
        self._shape = image.shape
        who, which = _mutual(position, blobs, np.full(len(rest), 0.5))
        # Each dot against itself later: a white patch that touches it belongs to it for good.
        self._areas[who] = area[which]
        self._first = position.copy()
        self._last = np.where(found[:, None], position, rest + shift)
        rings = self._sample_rings(
            np.where(found[:, None], position, rest), _unit(len(rest)), colours
        )
        texture = rings.std(axis=1).mean(axis=1)
        if np.median(texture[found]) >= self.rule.min_texture:
            self._rings = _normalised(rings)
            self._rings[~found] = 0.0
        ncc = (
            np.where(found, 1.0, np.nan) if self._rings is not None else np.full(len(rest), np.nan)
        )
        return self._observe(position, found, ncc, len(blobs), 0, start_s)

    # Later images

    def _follow(self, blobs: Array, area: Array, colours: Array) -> tuple[Array, Array, int]:
        """Match blobs to dots, and take back every match that does not stand a check."""
        n = len(self.rest_px)
        position = np.full((n, 2), np.nan)
        known = np.isfinite(self._first[:, 0])
        if not len(blobs):
            return position, np.full(n, np.nan), 0
        gate = np.full(n, self.rule.gate_pitch * self.pitch_px)
        # 1. Dots seen in the last frame, by their last place and the median motion around them.
        fresh = known & np.isfinite(self._seen[:, 0])
        self._assign(position, self._last + self._motion, blobs, gate, fresh)
        ncc, rejected = self._check(position, blobs, area, colours)
        # 2. Lost dots, where their neighbours' affine motion puts them. Twice: those found now
        # are neighbours of the next row.
        for _ in range(2):
            expected = self._extrapolate(position)
            lost = known & ~np.isfinite(position[:, 0]) & np.isfinite(expected[:, 0])
            if not lost.any():
                break
            self._assign(position, expected, blobs, gate, lost)
            ncc, more = self._check(position, blobs, area, colours)
            rejected += more
        # 3. Dots that moved beyond any prediction, by their colours alone.
        if self._rings is not None:
            lost = known & ~np.isfinite(position[:, 0])
            if lost.sum() > 0.1 * n:
                self._find_by_colours(position, blobs, lost, colours)
                ncc, more = self._check(position, blobs, area, colours)
                rejected += more
        return position, ncc, rejected

    def _assign(
        self, position: Array, expected: Array, blobs: Array, gate: Array, who: Array
    ) -> None:
        """Mutual nearest neighbours of the dots `who` and the blobs not taken yet, in place."""
        free = np.ones(len(blobs), bool)
        taken = position[np.isfinite(position[:, 0])]
        if len(taken):
            free = _distances(blobs, taken).min(axis=1) > 1e-6
        rows, spare = np.flatnonzero(who), np.flatnonzero(free)
        if len(rows) and len(spare):
            a, b = _mutual(expected[rows], blobs[spare], gate[rows])
            position[rows[a]] = blobs[spare[b]]

    def _check(
        self, position: Array, blobs: Array, area: Array, colours: Array
    ) -> tuple[Array, int]:
        """Order, identity and area; what fails is set to NaN. Returns identity and how many."""
        before = int(np.isfinite(position[:, 0]).sum())
        self._keep_order(position)
        ncc = np.full(len(position), np.nan)
        if self._rings is not None:
            ncc = self._identity(position, colours)
            position[np.isfinite(position[:, 0]) & ~(ncc >= self.rule.ncc_min)] = np.nan
        have = np.flatnonzero(np.isfinite(position[:, 0]))
        if len(have):
            which = np.argmin(_distances(position[have], blobs), axis=1)
            swelling = np.abs(np.linalg.det(self._affine(position)))
            self._keep_area(position, area, have, which, swelling)
        return ncc, before - int(np.isfinite(position[:, 0]).sum())

    def _keep_area(
        self, position: Array, area: Array, who: Array, which: Array, swelling: Array
    ) -> None:
        ratio = area[which] / (self._areas[who] * np.clip(swelling[who], 0.1, 10.0))
        limit = self.rule.area_factor
        position[who[(ratio > limit) | (ratio < 1 / limit)]] = np.nan

    def _keep_order(self, position: Array) -> None:
        """A continuous skin keeps the sense of every triangle of neighbours: drop what turns one.

        The dots in most turned triangles go first, until none is turned; of two that changed
        places both go, since one alone would turn nothing.
        """
        corner = position[self._triangles]
        a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        turned = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] <= 0  # False where NaN
        while turned.any():
            votes = np.bincount(self._triangles[turned].ravel(), minlength=len(position))
            worst = votes == votes.max()
            position[worst] = np.nan
            turned &= ~worst[self._triangles].any(axis=1)

    def _affine(self, position: Array) -> Array:
        """(n, 2, 2) local affine motion from the first image, by the neighbours with a position.

        Where fewer than four points spread over the plane are there: the median over the others.
        """
        matrix, _, good = self._fit(position)
        fallback = np.median(matrix[good], axis=0) if good.any() else np.eye(2)
        matrix[~good] = fallback
        return matrix

    def _fit(self, position: Array) -> tuple[Array, Array, Array]:
        """Least squares q = m + A (p - c) over each dot and its neighbours: A, q at p, is good."""
        group = np.concatenate((np.arange(len(position))[:, None], self._near), axis=1)
        p, q = self._first[group], position[group]
        weight = (np.isfinite(p[..., 0]) & np.isfinite(q[..., 0])).astype(float)
        p, q = np.nan_to_num(p), np.nan_to_num(q)
        total = np.maximum(weight.sum(1), 1.0)[:, None]
        c, m = (weight[..., None] * p).sum(1) / total, (weight[..., None] * q).sum(1) / total
        dp = (p - c[:, None]) * weight[..., None]
        dq = (q - m[:, None]) * weight[..., None]
        pp, qp = dp.transpose(0, 2, 1) @ dp, dq.transpose(0, 2, 1) @ dp
        # Spread both ways: the smaller eigenvalue of pp, against a quarter of a pitch squared.
        spread = np.linalg.eigvalsh(pp)[:, 0]
        good = (weight.sum(1) >= 4) & (spread > 0.25 * self.pitch_px**2)
        pp[~good] = np.eye(2)
        matrix = qp @ np.linalg.inv(pp)
        at = m + np.einsum("nij,nj->ni", matrix, np.nan_to_num(self._first) - c)
        return matrix, at, good & np.isfinite(self._first[:, 0])

    def _extrapolate(self, position: Array) -> Array:
        """(n, 2) where the neighbours' affine motion puts each dot; NaN where they do not tell."""
        _, at, good = self._fit(position)
        at[~good] = np.nan
        return at

    # Colours

    def _sample_rings(self, centre: Array, affine: Array, colours: Array) -> Array:
        """(n, k, 3) colours on each dot's deformed ring, less their plane: shading has no say."""
        points = centre[:, None, :] + self._ring @ affine.transpose(0, 2, 1)
        rings = sample(colours, points.astype(np.float32)).astype(np.float64)
        return rings - self._plane @ (self._plane.T @ rings)

    def _identity(self, position: Array, colours: Array) -> Array:
        """(n,) correlation of each dot's ring with that of the first image; NaN where lost."""
        assert self._rings is not None
        have = np.isfinite(position[:, 0])
        ncc = np.full(len(position), np.nan)
        if have.any():
            rings = self._sample_rings(position[have], self._affine(position)[have], colours)
            ncc[have] = np.einsum("nk,nk->n", _normalised(rings), self._rings[have])
        return ncc

    def _find_by_colours(self, position: Array, blobs: Array, lost: Array, colours: Array) -> None:
        """Mutual best correlation of the lost dots' rings and the free blobs, in place."""
        assert self._rings is not None
        taken = position[np.isfinite(position[:, 0])]
        free = np.arange(len(blobs))
        if len(taken):
            free = free[_distances(blobs, taken).min(axis=1) > 1e-6]
        rows = np.flatnonzero(lost)
        if not len(free) or not len(rows):
            return
        typical = np.median(self._affine(position), axis=0)
        rings = _normalised(
            self._sample_rings(blobs[free], np.repeat(typical[None], len(free), 0), colours)
        )
        ncc = self._rings[rows] @ rings.T
        best = np.argmax(ncc, axis=1)
        mutual = np.argmax(ncc, axis=0)[best] == np.arange(len(rows))
        sure = mutual & (ncc[np.arange(len(rows)), best] >= self.rule.ncc_found)
        position[rows[sure]] = blobs[free[best[sure]]]

    # Image

    def _whiteness(self, image: Array) -> Array:
        """(h, w) float32: min(B, G, R) over the local light, blurred."""
        lowest = cv2.min(cv2.min(image[..., 0], image[..., 1]), image[..., 2])
        h, w = lowest.shape
        shrink = max(2, round(self.pitch_px / 4))
        small = cv2.resize(
            image, (max(8, w // shrink), max(8, h // shrink)), interpolation=cv2.INTER_AREA
        )
        light = cv2.GaussianBlur(small.astype(np.float32).mean(axis=2), (0, 0), 5.0)
        light = np.maximum(light, 0.15 * float(np.median(light)) + 1.0)
        light = cv2.resize(light, (w, h), interpolation=cv2.INTER_LINEAR)
        blurred = cv2.GaussianBlur(
            lowest.astype(np.float32), (0, 0), self.rule.blur_d * self.diameter_px
        )
        return np.divide(blurred, light)

    def _blobs(self, white: Array, level: float) -> tuple[Array, Array]:
        """Centroids (m, 2) and areas (m,) of white blobs wholly inside the image."""
        h, w = white.shape
        _, labels, stats, _ = cv2.connectedComponentsWithStats(
            (white > level).astype(np.uint8), connectivity=4, ltype=cv2.CV_32S
        )
        side = stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]]
        corner = stats[:, [cv2.CC_STAT_LEFT, cv2.CC_STAT_TOP]]
        fits = (
            (stats[:, cv2.CC_STAT_AREA] >= 0.08 * self._nominal_area)
            & (stats[:, cv2.CC_STAT_AREA] <= 4.0 * self._nominal_area)
            & (corner > 0).all(1)
            & (corner[:, 0] + side[:, 0] < w)
            & (corner[:, 1] + side[:, 1] < h)
        )
        fits[0] = False
        y, x = np.nonzero(fits[labels])
        label = labels[y, x]
        weight = white[y, x].astype(np.float64) - level
        size = len(stats)
        mass = np.bincount(label, weight, size)[fits]
        centre = np.stack(
            (
                np.bincount(label, weight * x, size)[fits],
                np.bincount(label, weight * y, size)[fits],
            ),
            axis=-1,
        )
        return centre / mass[:, None], stats[fits, cv2.CC_STAT_AREA].astype(float)

    def _observe(
        self,
        position: Array,
        found: Array,
        ncc: Array,
        n_blobs: int,
        n_rejected: int,
        start_s: float,
    ) -> DotObservation:
        step = position - self._last
        near = step[self._near]
        have = np.isfinite(near[..., 0]).any(axis=1)
        motion = np.zeros_like(position)
        if found.any() and self._started:
            motion[have] = np.nanmedian(near[have], axis=1)
        self._motion = motion
        self._seen = position.copy()
        self._last = np.where(found[:, None], position, self._last)
        self._started = True
        return DotObservation(
            position,
            position - self._first,
            found,
            ncc,
            n_blobs,
            n_rejected,
            (time.process_time() - start_s) * 1e3,
        )


def _distances(a: Array, b: Array) -> Array:
    """(n, m) distances of two point sets."""
    return np.hypot(a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1])


def _mutual(expected: Array, blobs: Array, gate: Array) -> tuple[Array, Array]:
    """Rows and blobs that are each other's nearest, within each row's gate."""
    distance = _distances(expected, blobs)
    distance = np.where(np.isfinite(distance), distance, np.inf)
    nearest = np.argmin(distance, axis=1)
    rows = np.arange(len(expected))
    ok = (np.argmin(distance, axis=0)[nearest] == rows) & (distance[rows, nearest] <= gate)
    return rows[ok], nearest[ok]


def _normalised(rings: Array) -> Array:
    """(n, k, 3) to (n, 3 k) of unit length."""
    flat = rings.reshape(len(rings), -1)
    return flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)


def _unit(n: int) -> Array:
    return np.repeat(np.eye(2)[None], n, axis=0)


def _triangles(points: Array) -> Array:
    """(m, 3) Delaunay triangles as indices, all turning the same way (positive area)."""
    low = points.min(axis=0) - 1.0
    size = np.ptp(points, axis=0) + 3.0
    net = cv2.Subdiv2D((0, 0, int(np.ceil(size[0])), int(np.ceil(size[1]))))
    for p in points - low:
        net.insert((float(p[0]), float(p[1])))
    corners = np.asarray(net.getTriangleList(), dtype=np.float64).reshape(-1, 3, 2) + low
    distance = np.hypot(
        corners[:, :, None, 0] - points[None, None, :, 0],
        corners[:, :, None, 1] - points[None, None, :, 1],
    )
    index = np.argmin(distance, axis=2)
    index = index[(distance.min(axis=2) < 0.01).all(axis=1)]  # not the net's own outer corners
    a, b = points[index[:, 1]] - points[index[:, 0]], points[index[:, 2]] - points[index[:, 0]]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    index[area < 0] = index[area < 0][:, ::-1]
    # Needles along the hull turn over by small strains, and say nothing about order.
    longest = np.max([np.hypot(*side.T) for side in (a, b, a - b)], axis=0)
    return index[np.abs(area) > 0.2 * longest**2]
