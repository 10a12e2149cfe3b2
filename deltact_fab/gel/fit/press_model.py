"""Forces of a measured path per MPa of modulus: compared with the data by `fit`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...aliases import Field, Point2, Progress
from ...elasticity.material import GelMaterial
from ...shapes import Indenter, SkinDimensions
from .force_curve import ForceCurve, force_curve, force_path
from .measured import MeasuredIndentation

ROUNDING_MM = 0.02  # from the straight line: less than that a row is on it
STEP_MM = 0.25  # between solved points of a drag


class PressModel:
    """Forces of a measured path per MPa of modulus, for any friction and first touch.

    Rows before the first move in plane lie on the curve. From there on the path is solved at the
    first touch `touch_mm` and scaled with the curve for others nearby.
    """

    def __init__(
        self,
        data: MeasuredIndentation,
        skin: SkinDimensions,
        indenter: Indenter,
        at_mm: Point2,
        poisson: float,
        deepest_mm: float,
        spacing_mm: float,
        touch_mm: float = 0.0,
        progress: Progress | None = None,
    ) -> None:
        self._data, self._skin, self._indenter, self._at = data, skin, indenter, at_mm
        self._poisson, self._deepest, self.spacing_mm = poisson, deepest_mm, spacing_mm
        self.touch_mm, self._progress = touch_mm, progress
        self._curves: dict[float, ForceCurve] = {}
        self._paths: dict[float, Field] = {}
        rows, channels = [], []
        n = len(data.depth_mm)
        for c, column in enumerate([data.normal_n, *data.tangential_n.T]):
            # Without a move in plane a side force says nothing that the normal one does not.
            some = np.isfinite(column) & (data.sheared | (c == 0))
            rows.append(np.arange(n)[some])
            channels.append(np.full(int(some.sum()), c))
        self.rows, self.channel = np.concatenate(rows), np.concatenate(channels)
        self.measured_n = np.column_stack([data.normal_n, data.tangential_n])[
            self.rows, self.channel
        ]

    def unit_n(self, coefficients: Sequence[float], friction: float, touch_mm: float) -> Field:
        """Forces (p,) per MPa, interpolated between the solved coefficients."""
        from scipy.interpolate import PchipInterpolator

        if friction in coefficients:
            return self._at_coefficient(friction, touch_mm)
        solved = [self._at_coefficient(mu, touch_mm) for mu in coefficients]
        return np.asarray(PchipInterpolator(coefficients, solved, axis=0)(friction))

    def _at_coefficient(self, mu: float, touch_mm: float) -> Field:
        data, depth = self._data, self._data.depth_mm - touch_mm
        material = GelMaterial(1.0, self._poisson, mu)
        if mu not in self._curves:
            self._curves[mu] = force_curve(
                self._skin, material, self._indenter, self._at, self._deepest,
                spacing_mm=self.spacing_mm, progress=self._progress,
            )  # fmt: skip
        normal = self._curves[mu].normal_n(depth)
        force = np.column_stack([normal, np.zeros((len(normal), 2))])
        later = data.sheared
        if later.any():
            if mu not in self._paths:
                self._paths[mu] = self._solved_path(material)
            base = self._curves[mu].normal_n(data.depth_mm - self.touch_mm)
            ratio = np.where(base > 0, normal / np.where(base > 0, base, 1.0), 1.0)
            force[later] = self._paths[mu] * ratio[later, None]
        return force[self.rows, self.channel]

    def _solved_path(self, material: GelMaterial) -> Field:
        """Forces (rows in shear, 3), the first one positive when pressed."""
        data = self._data
        depth = data.depth_mm - self.touch_mm
        way = np.column_stack([np.array(self._at) + data.shear_mm, depth])
        start = int(np.argmax(data.sheared))
        # What came before is a press down to where the drag starts: the deepest before it first,
        # for the slip that a deeper press left.
        first = np.column_stack([np.tile(self._at, (2, 1)), [0.0, max(depth[start], 0.0)]])
        if start:
            first = np.vstack([first, [*self._at, max(depth[start - 1], 0.0)]])
        knots, length = _thinned(way[start:])
        forces = force_path(
            self._skin, material, self._indenter, np.vstack([first, way[start:][knots]]),
            spacing_mm=self.spacing_mm, progress=self._progress,
        )[len(first) :]  # fmt: skip
        at_rows = np.column_stack([np.interp(length, length[knots], f) for f in forces.T])
        return at_rows[:, [2, 0, 1]] * np.array([-1.0, 1.0, 1.0])


def _thinned(way_mm: Field) -> tuple[NDArray[np.int64], Field]:
    """Rows of a path (n, 3) that are worth solving, and the length of the way at all rows (n,).

    Corners (Douglas and Peucker) and, between them, a row about every STEP_MM.
    """
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way_mm, axis=0), axis=1))])
    keep = {0, len(way_mm) - 1}
    open_ends = [(0, len(way_mm) - 1)]
    while open_ends:
        i, j = open_ends.pop()
        if j - i < 2:
            continue
        chord = way_mm[j] - way_mm[i]
        size2 = float(chord @ chord)
        off = way_mm[i : j + 1] - way_mm[i]
        t = np.clip(off @ chord / size2, 0.0, 1.0) if size2 > 0 else np.zeros(len(off))
        away = np.linalg.norm(off - t[:, None] * chord, axis=1)
        k = i + int(away.argmax())
        if away.max() > ROUNDING_MM:
            keep.add(k)
            open_ends += [(i, k), (k, j)]
    last = 0
    for k in range(len(way_mm)):
        if k in keep or length[k] - length[last] >= STEP_MM:
            keep.add(k)
            last = k
    # Rows on the spot have the same length; one of them is enough to interpolate from.
    ordered = sorted(keep)
    distinct = [k for n, k in enumerate(ordered) if n == 0 or length[k] > length[ordered[n - 1]]]
    return np.array(distinct), length
