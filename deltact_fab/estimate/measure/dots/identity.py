"""Matching of blobs to dots: by their neighbours, and by the colours around them if there are any.

Nearest neighbours are only a first guess. Every match must pass the checks of order and colours,
else it is dropped: a lost dot does less harm than a wrong one.
"""

from __future__ import annotations

import cv2
import numpy as np

from deltact_fab.common import Array

from ..compose import sample
from .detect import Blobs
from .skin import Skin, mutual_nearest

# By hand, on two runs of docs/evidence/dots.md: looser gives wrong identities, stricter loses dots.
MAX_AREA_FACTOR = 1.7  # to a dot's predicted area; beyond, it is partly covered or merged
GATE_PITCHES = 0.45  # search radius around a predicted dot
# A lost dot is searched where its neighbours have carried it for MAX_LOST_FRAMES, then where their
# affine motion predicts it, within REGAIN_PITCHES; by hand, as above.
MAX_LOST_FRAMES = 2
REGAIN_PITCHES = 0.3
ODD_SHARE = 0.02  # of the dots: a score this much lower than the last makes other guesses tried
STEP_TOLERANCE = 0.3  # difference of two neighbours' steps per frame, over their distance
MIN_RING_NCC = 0.5  # of the ring of colours, for the same dot
MAX_RING_LIKENESS = 0.3  # median correlation of the rings of different dots
REGAIN_NCC = 0.65  # of the ring, for a dot regained anywhere in the image


class Identities:
    """Matcher of a skin's dots to the blobs of each frame.

    first_px: (n, 2) positions in the first frame, NaN for a missing dot; area_px: (n,) areas
    there. rings: colours around the dots, None without any; `image` is the smoothed image that
    they are sampled from.
    """

    def __init__(
        self, skin: Skin, first_px: Array, area_px: Array, rings: Rings | None = None
    ) -> None:
        self._skin, self._rings = skin, rings
        self._gate_px = GATE_PITCHES * skin.pitch_px
        self.first_px, self._first_area = first_px, area_px
        self._registered = np.isfinite(first_px[:, 0])
        n = len(first_px)
        self._place = first_px.copy()  # of each dot, predicted where it is not visible
        self._missed = np.where(self._registered, 0, np.iinfo(int).max // 2)  # frames since then
        self._motion = np.zeros_like(first_px)
        self._last_score = float(self._registered.sum())
        # State of the current frame
        self._position = first_px.copy()
        self._blob = np.full(n, -1)
        self._intact = np.ones(n, bool)  # neither partly covered nor merged with another
        self._ncc = np.full(n, np.nan)

    def follow(self, blobs: Blobs, image: Array | None = None) -> tuple[Array, Array]:
        """Match a frame's blobs; return positions (n, 2), NaN where lost, and ring NCC (n,)."""
        previous = self._position
        self._position = np.full_like(previous, np.nan)
        self._ncc = np.full(len(previous), np.nan)
        if len(blobs):
            self._match_by_motion(blobs, image)
            self._match_by_neighbours(blobs, image)
            self._match_by_colours(blobs, image)
        self._remember(previous)
        # A partly visible dot keeps its blob, so that no other takes it; its centroid is dropped
        part = self._located & ~self._intact
        return np.where(part[:, None], np.nan, self._position), self._ncc.copy()

    @property
    def _located(self) -> Array:
        located: Array = np.isfinite(self._position[:, 0])
        return located

    def _match_by_motion(self, blobs: Blobs, image: Array | None) -> None:
        """Match recent dots, by the first guess of the skin's motion that explains them well."""
        recent = self._registered & (self._missed <= MAX_LOST_FRAMES)
        if not recent.any():
            return
        visible = int((self._missed == 0).sum())
        best, best_score = np.full(len(self._place), -1), -np.inf
        # Constant velocity, reversed with the stage, at rest, released.
        for guess in (
            self._place + self._motion,
            self._place - self._motion,
            self._place,
            self.first_px,
        ):
            expected = np.where(recent[:, None], guess, np.nan)
            for match in self._skin.grow(expected, blobs.centre_px, self._gate_px, STEP_TOLERANCE):
                score = self._match_score(expected, match, blobs)
                if score > best_score + (2 if np.isfinite(best_score) else 0):
                    best, best_score = match, score
            if best_score >= self._last_score - max(2.0, ODD_SHARE * visible):
                break
        self._last_score = best_score
        self._assign(np.flatnonzero(best >= 0), best[best >= 0], blobs, image)

    def _match_score(self, expected: Array, match: Array, blobs: Blobs) -> float:
        """Score a match: dots consistent with their neighbours, less surprise and idle blobs."""
        have = match >= 0
        position = self._matched_px(blobs, match)
        surprise = np.hypot(*(position - expected)[have].T).sum() / self._skin.pitch_px
        idle = len(blobs) - have.sum()
        bent = self._skin.count_bent(self.first_px, position)
        return float(have.sum() - bent - 0.25 * surprise - 0.5 * idle)

    def _match_by_neighbours(self, blobs: Blobs, image: Array | None) -> None:
        """Match lost dots where their neighbours' affine motion predicts them, repeatedly.

        A blob must be near for the local spacing, and much nearer to its dot than to any other.
        """
        from scipy.spatial import cKDTree

        share = REGAIN_PITCHES if self._rings is None else GATE_PITCHES
        for _ in range(6):
            missing = self._registered & ~self._located
            free = self._free_blobs(blobs)
            if not missing.any() or not len(free) or self._located.sum() < 3:
                return
            _, predicted, good = self._skin.fit(self.first_px, self._position)
            rows = np.flatnonzero(good & missing)
            if not len(rows):
                return
            all_ = np.where(self._located[:, None], self._position, predicted)
            all_ = all_[np.isfinite(all_[:, 0])]
            distance = cKDTree(all_).query(predicted[rows], 2)[0]
            gate = np.full(len(predicted), np.nan)
            gate[rows] = share * np.minimum(distance[:, 1], self._skin.pitch_px)
            predicted[~(good & missing)] = np.nan
            dot, blob = mutual_nearest(predicted, blobs.centre_px[free], gate)
            if not self._assign(dot, free[blob], blobs, image):
                return

    def _match_by_colours(self, blobs: Blobs, image: Array | None) -> None:
        """Match dots that moved beyond any prediction, by their colours."""
        missing = np.flatnonzero(self._registered & ~self._located)
        free = self._free_blobs(blobs)
        few = len(missing) <= 0.1 * len(self._registered) or not len(free)
        if few or self._rings is None or image is None:
            return
        matrix = np.median(self._skin.affine(self.first_px, self._position), axis=0)
        affine = np.repeat(matrix[None], len(free), axis=0)
        dot, blob = self._rings.match(image, missing, blobs.centre_px[free], affine, REGAIN_NCC)
        self._assign(missing[dot], free[blob], blobs, image)

    def _matched_px(self, blobs: Blobs, match: Array) -> Array:
        position: Array = np.where((match >= 0)[:, None], blobs.centre_px[match], np.nan)
        return position

    def _free_blobs(self, blobs: Blobs) -> Array:
        return np.setdiff1d(np.arange(len(blobs)), self._blob[self._located])

    def _assign(self, dot: Array, blob: Array, blobs: Blobs, image: Array | None) -> bool:
        """Assign blobs to dots, checking order, colours and area. True if any dot was gained."""
        if not len(dot):
            return False
        n_located = int(self._located.sum())
        self._position[dot] = blobs.centre_px[blob]
        self._blob[dot] = blob
        if self._rings is None:
            self._skin.drop_strays(self.first_px, self._position)
        self._skin.keep_order(self._position)
        matrix = self._skin.affine(self.first_px, self._position)
        if self._rings is not None and image is not None:
            have = np.flatnonzero(self._located)
            self._ncc[have] = self._rings.correlate(image, have, self._position[have], matrix[have])
            self._position[~(self._ncc >= MIN_RING_NCC)] = np.nan
        self._ncc[~self._located] = np.nan
        have = np.flatnonzero(self._located)
        swelling = np.clip(np.abs(np.linalg.det(matrix[have])), 0.1, 10.0)
        ratio = blobs.area_px[self._blob[have]] / (self._first_area[have] * swelling)
        change = np.abs(np.log(ratio)) / np.log(MAX_AREA_FACTOR)
        self._intact[have] = change <= 1
        self._position[have[change > 3]] = np.nan
        return int(self._located.sum()) > n_located

    def _remember(self, previous: Array) -> None:
        """Store positions and motions for the next frame; lost dots move with their neighbours."""
        located = self._located
        near = (self._position - previous)[self._skin.near]
        have = np.isfinite(near[..., 0]).any(axis=1)
        self._motion = np.zeros_like(self._position)
        # The mean would let a stray dot lead its neighbours
        self._motion[have] = np.nanmedian(near[have], axis=1)
        along = self._skin.mean_step(previous, self._position)
        self._place = np.where(located[:, None], self._position, self._place + np.nan_to_num(along))
        self._missed = np.where(located, 0, self._missed + 1)


class Rings:
    """Colours around all dots, which distinguish a dot from its neighbours.

    Each is sampled on a ring between two radii, in pixels of an image reduced by `shrink`. Centres
    are positions in the full image, (n, 2) px; images are reduced and smoothed.
    """

    def __init__(self, inner_px: float, outer_px: float, shrink: int) -> None:
        self._shrink = shrink
        radii = np.arange(min(inner_px, outer_px), outer_px + 1e-9, 2.0)
        self._ring = np.concatenate(
            [
                r * np.stack((np.cos(a), np.sin(a)), -1)
                for r in radii
                for a in [np.arange(max(8, int(np.pi * r))) * (2 * np.pi / max(8, int(np.pi * r)))]
            ]
        )
        # Orthonormal basis of 1, x, y on the ring.
        self._plane = np.linalg.qr(np.column_stack((np.ones(len(self._ring)), self._ring)))[0]
        self._first: Array | None = None

    def smooth(self, small: Array) -> Array:
        """Smooth a reduced image, to compare colours at the scale of a patch, not of a pixel."""
        return cv2.GaussianBlur(small, (0, 0), 1.5 / self._shrink)

    def remember(self, image: Array, centre: Array, min_texture: float) -> bool:
        """Store the rings of the first image, (n, 2) centres with NaN; False if not distinctive.

        min_texture: least median standard deviation of the rings, grey levels. The edges of the
        next dots reach it too, but then all rings look alike.
        """
        located = np.isfinite(centre[:, 0])
        unit = np.repeat(np.eye(2)[None], len(centre), axis=0)
        rings = self._sample(image, np.nan_to_num(centre), unit)
        self._first = None
        if np.median(rings.std(axis=1).mean(axis=1)[located]) < min_texture:
            return False
        first = _normalised(rings)
        if np.median(first[located] @ first[located].T) > MAX_RING_LIKENESS:
            return False
        first[~located] = 0.0
        self._first = first
        return True

    def correlate(self, image: Array, dots: Array, centre: Array, affine: Array) -> Array:
        """Correlation (m,) of m dots, by index, with their first rings; centre (m, 2)."""
        assert self._first is not None
        current = _normalised(self._sample(image, centre, affine))
        ncc: Array = np.einsum("nk,nk->n", current, self._first[dots])
        return ncc

    def match(
        self, image: Array, dots: Array, centre: Array, affine: Array, min_ncc: float
    ) -> tuple[Array, Array]:
        """Mutually best matches of dots and positions: rows of `dots` and of `centre`."""
        assert self._first is not None
        ncc = self._first[dots] @ _normalised(self._sample(image, centre, affine)).T
        rows, best = np.arange(len(dots)), np.argmax(ncc, axis=1)
        accepted = (np.argmax(ncc, axis=0)[best] == rows) & (ncc[rows, best] >= min_ncc)
        return rows[accepted], best[accepted]

    def _sample(self, image: Array, centre: Array, affine: Array) -> Array:
        """Colours (n, k, 3) on each dot's deformed ring, less their plane, to remove shading."""
        centre = (centre + 0.5) / self._shrink - 0.5
        points = centre[:, None, :] + self._ring @ affine.transpose(0, 2, 1)
        rings = sample(image, points.astype(np.float32)).astype(np.float64)
        return rings - self._plane @ (self._plane.T @ rings)


def _normalised(rings: Array) -> Array:
    """Flatten (n, k, 3) to (n, 3 k) of unit length."""
    flat = rings.reshape(len(rings), -1)
    return flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
