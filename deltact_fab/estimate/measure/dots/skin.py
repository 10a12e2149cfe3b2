"""Continuity of a skin of dots: predictions from neighbours, and checks of their order.

Neighbours move almost alike from one frame to the next, a triangle of neighbours never turns over,
and the affine motion around a dot predicts its position.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from deltact_fab.common import Array

STRAY_FACTOR, STRAY_PITCH = 3.0, 0.25  # by hand: looser keeps wrong dots, stricter drops a fold's
MAX_LENT_STRAIN = 0.05  # for borrowing it from farther dots; by hand: more predicts too far off


class Skin:
    """Dots at rest, (n, 2) px, n >= 4 not on a line, and their neighbours.

    near: (n, k) the k <= 8 nearest dots of each; span_px: (n, k) their distances; pitch_px: the
    smallest distance; triangles: (m, 3) dots, of positive orientation.
    """

    def __init__(self, rest_px: Array) -> None:
        from scipy.spatial import cKDTree

        self.rest_px = rest_px
        count = min(8, len(rest_px) - 1)
        span, near = cKDTree(rest_px).query(rest_px, count + 1)
        # A dot is not its own neighbour; of dots in one place either may come first
        self.near, self.span_px = near[:, 1:], span[:, 1:]
        self.pitch_px = float(self.span_px.min())
        self.triangles = _triangles(rest_px)

    def grow(
        self, expected: Array, blobs: Array, gate_px: float, tolerance: float
    ) -> Iterator[Array]:
        """Yield matches, (n,) blob of each dot or -1, in which neighbours move almost equally.

        expected: (n, 2), NaN for dots to ignore. Each dot first takes its nearest blob, which
        beyond half a pitch is another dot's; then each of the largest regions of similar steps is
        grown over the rest.
        """
        match = np.full(len(expected), -1)
        dot, blob = mutual_nearest(expected, blobs, gate_px)
        match[dot] = blob
        regions = self._regions(expected, blobs, match, tolerance)
        sizes = np.bincount(regions[regions >= 0], minlength=len(expected))
        for region in np.argsort(-sizes, kind="stable")[:4]:
            if sizes[region] < max(1, min(4, sizes.max())):
                return
            spread = self._spread(expected, blobs, np.where(regions == region, match, -1), gate_px)
            yield self._drop_odd(expected, blobs, spread, tolerance)
            if sizes[region] > 0.9 * len(dot):
                return

    def _steps(self, expected: Array, blobs: Array, match: Array) -> Array:
        steps = blobs[match] - expected
        steps[match < 0] = np.nan
        return steps

    def _regions(self, expected: Array, blobs: Array, match: Array, tolerance: float) -> Array:
        """Label (n,) groups of neighbours that move together, -1 where not matched."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        steps = self._steps(expected, blobs, match)
        difference = np.hypot(*np.moveaxis(steps[self.near] - steps[:, None], -1, 0))
        similar = difference <= tolerance * self.span_px  # False where NaN
        first, second = np.nonzero(similar)[0], self.near[similar]
        links = coo_array((np.ones(len(first), bool), (first, second)), shape=(len(match),) * 2)
        return np.where(match >= 0, connected_components(links, directed=False)[1], -1)

    def _spread(self, expected: Array, blobs: Array, match: Array, gate_px: float) -> Array:
        """Match dots next to two matched ones at the position that these predict, repeatedly."""
        match = match.copy()
        open_ = np.isfinite(expected[:, 0])
        while True:
            matched = np.where((match >= 0)[:, None], blobs[match], np.nan)
            have = (match >= 0)[self.near].sum(axis=1)
            rows = np.flatnonzero(open_ & (match < 0) & (have >= 2))
            free = np.setdiff1d(np.arange(len(blobs)), match[match >= 0])
            if not len(rows) or not len(free):
                return match
            step = self.mean_step(expected, matched)[rows]
            a, b = mutual_nearest(expected[rows] + step, blobs[free], gate_px)
            if not len(a):
                return match
            match[rows[a]] = free[b]

    def _drop_odd(self, expected: Array, blobs: Array, match: Array, tolerance: float) -> Array:
        """Drop the dots whose step differs from that of most of their neighbours."""
        steps = self._steps(expected, blobs, match)
        near = steps[self.near]
        difference = np.hypot(*np.moveaxis(near - steps[:, None], -1, 0))
        have = np.isfinite(near[..., 0])
        similar = (difference <= tolerance * self.span_px).sum(axis=1)
        odd = (have.sum(axis=1) >= 3) & (2 * similar < have.sum(axis=1))
        return np.where(odd, -1, match)

    def drop_strays(self, first: Array, position: Array) -> None:
        """Drop, in place, dots much farther from their prediction by neighbours than these are from
        theirs (median test of Westerweel and Scarano 2005), the farthest first."""
        for _ in range(10):
            _, predicted, _ = self.fit(first, position)
            residual = np.hypot(*(position - predicted).T)
            # A zero more, so that no single neighbour is the median
            near = np.column_stack((residual[self.near], np.zeros(len(residual))))
            limit = STRAY_FACTOR * np.nanmedian(near, axis=1) + STRAY_PITCH * self.pitch_px
            stray = (residual > limit) & (residual >= np.nanmax(near, axis=1))
            if not stray.any():
                return
            position[stray] = np.nan

    def keep_order(self, position: Array) -> None:
        """Drop, in place, dots that turn triangles of neighbours over, those in most first."""
        corner = position[self.triangles]
        a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        turned = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] <= 0  # False where NaN
        while turned.any():
            votes = np.bincount(self.triangles[turned].ravel(), minlength=len(position))
            worst = votes == votes.max()
            position[worst] = np.nan
            turned &= ~worst[self.triangles].any(axis=1)

    def fit(self, first: Array, position: Array) -> tuple[Array, Array, Array]:
        """Fit the affine motion around each dot, from `first` to `position`, both (n, 2) with NaN.

        Least squares over the neighbours without the dot itself. Returns matrices (n, 2, 2),
        predicted positions (n, 2), and a mask (n,) of dots with enough neighbours: three or more,
        spread over the plane, or two that borrow the strain from such neighbours of their own.
        """
        p, q = first[self.near], position[self.near]
        weight = (np.isfinite(p[..., 0]) & np.isfinite(q[..., 0])).astype(float)
        p, q = np.nan_to_num(p), np.nan_to_num(q)
        total = np.maximum(weight.sum(1), 1.0)[:, None]
        c, m = (weight[..., None] * p).sum(1) / total, (weight[..., None] * q).sum(1) / total
        dp = (p - c[:, None]) * weight[..., None]
        dq = (q - m[:, None]) * weight[..., None]
        pp, qp = dp.transpose(0, 2, 1) @ dp, dq.transpose(0, 2, 1) @ dp
        # Spread both ways: the smaller eigenvalue of pp, against a quarter of a pitch squared.
        xx, xy, yy = pp[:, 0, 0], pp[:, 0, 1], pp[:, 1, 1]
        spread = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)
        good = (weight.sum(1) >= 3) & (spread > 0.25 * self.pitch_px**2)
        pp[~good] = np.eye(2)
        matrix = qp @ np.linalg.inv(pp)
        # Neighbours on one line, as where a row comes back into view, do not determine the strain
        determined = good[self.near]
        lent = (matrix[self.near] * determined[..., None, None]).sum(1)
        lent /= np.maximum(determined.sum(1), 1)[:, None, None]
        small = np.abs(lent - np.eye(2)).max(axis=(1, 2)) < MAX_LENT_STRAIN
        borrow = ~good & (weight.sum(1) >= 2) & (determined.sum(1) >= 2) & small
        matrix[borrow] = lent[borrow]
        good |= borrow
        predicted = m + np.einsum("nij,nj->ni", matrix, np.nan_to_num(first) - c)
        good &= np.isfinite(first[:, 0])
        predicted[~good] = np.nan
        return matrix, predicted, good

    def mean_step(self, start: Array, end: Array) -> Array:
        """Mean step (n, 2) of each dot's neighbours, weighted to near ones; NaN without any."""
        near = (end - start)[self.near]
        weight = np.isfinite(near[..., 0]) / self.span_px**2
        total = weight.sum(axis=1)[:, None]
        step: Array = (weight[..., None] * np.nan_to_num(near)).sum(axis=1)
        return np.divide(step, total, out=np.full_like(step, np.nan), where=total > 0)

    def count_bent(self, first: Array, position: Array) -> int:
        """Count the dots more than half a pitch from their prediction by neighbours."""
        _, predicted, _ = self.fit(first, position)
        return int((np.hypot(*(position - predicted).T) > 0.5 * self.pitch_px).sum())

    def affine(self, first: Array, position: Array) -> Array:
        """Matrices (n, 2, 2) of `fit`; the median of the others where it is not determined."""
        matrix, _, good = self.fit(first, position)
        matrix[~good] = np.median(matrix[good], axis=0) if good.any() else np.eye(2)
        return matrix


def mutual_nearest(expected: Array, blobs: Array, gate_px: float | Array) -> tuple[Array, Array]:
    """Mutually nearest rows of `expected` and `blobs`, at most gate_px apart."""
    from scipy.spatial import cKDTree

    rows = np.flatnonzero(np.isfinite(expected[:, 0]))
    if not len(rows) or not len(blobs):
        return rows[:0], rows[:0]
    distance, nearest = cKDTree(blobs).query(expected[rows])
    _, back = cKDTree(expected[rows]).query(blobs)
    gate = np.broadcast_to(gate_px, len(expected))[rows]
    ok = (back[nearest] == np.arange(len(rows))) & (distance <= gate)
    return rows[ok], nearest[ok]


def _triangles(points: Array) -> Array:
    """Delaunay triangles (m, 3) as indices, all of positive area."""
    from scipy.spatial import Delaunay

    index = Delaunay(points).simplices
    a, b = points[index[:, 1]] - points[index[:, 0]], points[index[:, 2]] - points[index[:, 0]]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    index[area < 0] = index[area < 0][:, ::-1]
    # Thin triangles along the hull turn over under small strains, and do not constrain the order.
    longest = np.max([np.hypot(*side.T) for side in (a, b, a - b)], axis=0)
    return index[np.abs(area) > 0.2 * longest**2]
