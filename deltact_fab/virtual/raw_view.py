"""The lens's own image of a flat view: where each of its pixels looks on the resting face.

The moved face is drawn in a flat view, where the lens leaves a map as smooth as a pinhole's; what
the lens does to the resting face is the same for every frame and is applied once, here.
"""

from __future__ import annotations

import cv2
import numpy as np

from ..aliases import Float
from ..optics import Fisheye, Rectified

BAND_PX = 40
"""Drawn around the tracked view, for a calibration that is a little off; the rest stays dark."""


class RawView:
    """Raw pixels (h, w) of a lens on a flat view of the face, which is BAND_PX larger all round."""

    def __init__(self, lens: Fisheye, view: Rectified) -> None:
        """lens: what is drawn through. view: what is tracked, of which the size counts."""
        self.lens = lens
        self.flat = Rectified(
            lens, view.mm_per_px, view.width_px + 2 * BAND_PX, view.height_px + 2 * BAND_PX
        )
        # With a border of one pixel, so that a halved grid is interpolated at the edge too.
        columns, rows = np.arange(-1, lens.width_px + 1), np.arange(-1, lens.height_px + 1)
        raw = np.stack(np.meshgrid(columns, rows), axis=-1).astype(float)
        looks = self.flat.rest_px(lens.rest_mm(raw))
        edge = (self.flat.width_px - 0.5, self.flat.height_px - 0.5)
        with np.errstate(invalid="ignore"):
            seen = np.all((looks > -0.5) & (looks < edge), axis=-1)
        seen = np.pad(seen[1:-1, 1:-1], 1)
        across, down = (np.flatnonzero(np.any(seen, axis=k)) for k in (0, 1))
        self._rows, self._columns = slice(down[0], down[-1] + 1), slice(across[0], across[-1] + 1)
        wide = (slice(down[0] - 1, down[-1] + 2), slice(across[0] - 1, across[-1] + 2))
        # A pixel that looks past the flat view is dark, whatever stands here.
        near = np.clip(np.nan_to_num(looks[wide], nan=0.0), -1, np.add(edge, 0.5))
        self._map = cv2.split(near.astype(np.float32) + 1)  # of a grid with a border
        self._seen = seen[self._rows, self._columns][..., None]
        corner_px = np.hypot(view.width_px, view.height_px) / 2
        off = (looks[1:-1, 1:-1] - np.asarray(self.flat.centre_px)) / corner_px
        self.off: Float = np.nan_to_num(off, nan=np.inf)
        """Of raw pixels (h, w, 2) from the view's middle, in its half diagonals; inf: unseen."""

    def look(self, flat: Float) -> Float:
        """What stands at each pixel of the flat view, on the raw pixels that see it.

        flat: (h, w[, 2]) with a border of one pixel, and so is what is returned.
        """
        return np.asarray(cv2.remap(flat, self._map[0], self._map[1], cv2.INTER_LINEAR), np.float32)

    def framed(self, radiance: Float) -> Float:
        """The raw image (h, w, c) with this in its place and the rest dark."""
        size = (self.lens.height_px, self.lens.width_px, radiance.shape[-1])
        whole = np.zeros(size, np.float32)
        at = (
            slice(self._rows.start - 1, self._rows.stop - 1),
            slice(self._columns.start - 1, self._columns.stop - 1),
        )
        whole[at] = radiance * self._seen
        return whole
