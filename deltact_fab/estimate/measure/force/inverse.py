"""Force from what presses on the face, found by inverting the linear operator of the free block.

A camera tells two numbers a point and traction has three, and a bonded gel hides an even pressure:
left alone, an inverse explains a press by shear. So it goes in two steps. The first, precomputed,
looks for pressure over the whole view, shear held small. The second keeps to the cells around what
that found, and asks for pressure, never pull, and for little shear where there is little pressure.

Tractions are for a Young's modulus of 1 MPa, so in effect strains. Their total is the force but for
that modulus and a few percent that linear elasticity leaves out: so a calibration gives a force a
factor, which may depend a little on the place.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np
from scipy import linalg, ndimage, optimize

from deltact_fab.common import Array
from deltact_fab.sensor import CameraModel, FaceCells, axes_mm

from ..face import FaceFlow, whole
from ..sensor_id import SensorModel
from .model import Features, ForceModel, TractionField

STEP_MM = 1e-3


def sight(camera: CameraModel, x_mm: Array, y_mm: Array) -> Array:
    """Shift of the picture, mm of the resting face, for displacements of 1 mm: (ny, nx, 2, 3).

    At points x_mm (nx,), y_mm (ny,) of the face, at rest. Of a pinhole it is
    u_xy - (x, y) u_z / (n eye distance): off the axis, depth is seen as motion.
    """
    at = np.stack((*np.meshgrid(x_mm, y_mm), np.zeros((len(y_mm), len(x_mm)))), axis=-1)
    ways = STEP_MM * np.eye(3)
    moved = [camera.project_px(at + way) - camera.project_px(at - way) for way in ways]
    return np.stack(moved, axis=-1) * (camera.mm_per_px / (2 * STEP_MM))


CELL_MM = 1.0
BEYOND_MM = 2.0  # a contact may reach out of the view
NOISE_MM = 0.002  # rms error of the shift of a cell's picture: 0.05 px of the paper's camera
MODEL = 0.02  # what linear elasticity leaves unexplained, of the largest shift
FIRST = {"pressure": 0.1, "shear": 0.015, "reach_mm": 1.5, "error_mm": 0.01}
ENOUGH = 0.25  # of the first look's peak: cells of the contact
AROUND = 2  # cells around them
MAX_CELLS = 300
ROUGH = {"pressure": 3e-3, "shear": 1.5e-2}
LITTLE = {"pressure": 3e-4, "shear": 7e-3}
LEAST = 0.05  # of the first look's peak, for cells that it saw nothing in
FOREIGN = 0.55  # of the shift's size, left over beside noise: that was no press
FLOOR = 5.0  # a peak of the first look this many times what noise makes of it is a contact


class FaceInverse:
    """The inverse for one sensor: seconds to make, then used for every frame; see `inverse_for`.

    The weight of smoothness goes with the square of (NOISE_MM^2 + (MODEL x largest shift)^2)^(1/2)
    over the largest shift, so it is that of the model's error for all but light presses. Raises
    InputError for a skin or a Poisson's ratio that the free sides cannot take.
    """

    def __init__(self, view: SensorModel) -> None:
        cells = FaceCells.from_skin(view.skin, view.poisson, CELL_MM)
        xs, ys = axes_mm(view.camera)
        half = view.camera.mm_per_px / 2
        seen = _window(cells, (ys[0] - half, ys[-1] + half), (xs[0] - half, xs[-1] + half))
        out = round(BEYOND_MM / CELL_MM)
        rows, columns = (
            slice(max(cut.start - out, 0), min(cut.stop + out, len(at)))
            for cut, at in zip(seen, (cells.y_mm, cells.x_mm), strict=True)
        )
        inner_rows, inner_columns = seen
        self.x_mm, self.y_mm = cells.x_mm[columns], cells.y_mm[rows]
        self.seen_x_mm, self.seen_y_mm = cells.x_mm[inner_columns], cells.y_mm[inner_rows]
        self.cell_mm2 = cells.cell_mm2
        self._inner = (
            slice(inner_rows.start - rows.start, inner_rows.stop - rows.start),
            slice(inner_columns.start - columns.start, inner_columns.stop - columns.start),
        )
        found = cells.compliance(seen, (rows, columns))
        n = len(self.y_mm) * len(self.x_mm)
        # A row for each cell that may be loaded: those of a contact lie in one piece each.
        self._sinks = np.ascontiguousarray(found.reshape(-1, 3, 3 * n)[:, 2].T, np.float32)
        see = sight(view.camera, self.seen_x_mm, self.seen_y_mm).reshape(-1, 2, 3)
        rows_of = np.matmul(see, found.reshape(len(see), 3, 3 * n)).reshape(-1, 3 * n)
        self._told = np.ascontiguousarray(rows_of.T, np.float32)
        self._gram = (rows_of.T @ rows_of).astype(np.float32)
        self._first, self._floor = self._first_look(rows_of)
        self._last: tuple[FaceFlow, TractionField] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells that may be loaded."""
        return len(self.y_mm), len(self.x_mm)

    def of(self, flow: FaceFlow) -> TractionField:
        """The traction behind a frame's flow, found once and kept for the calls that follow.

        For a modulus of 1 MPa, on cells of the face: 0 beside the contact, t_z <= 0. cover: share
        of the pressure whose cells' motion is known; what lies out of the view is not. Without a
        contact, that of the view. 0 with no traction where no press could move a face so.
        """
        last = self._last
        if last is None or last[0] is not flow:
            self._last = last = (flow, self._solved(flow))
        return last[1]

    def _solved(self, flow: FaceFlow) -> TractionField:
        shift, known = self._cells(flow)
        traction = np.zeros((*self.shape, 3))
        cover = float(known.mean())
        look = (self._first @ shift.ravel().astype(np.float32)).reshape(self.shape)
        certain = look > self._floor
        if not certain.any():
            return TractionField(traction, self.x_mm, self.y_mm, cover)
        mask = _around(look > ENOUGH * look[certain].max())
        if np.count_nonzero(mask) > MAX_CELLS:
            mask &= look >= np.sort(look[mask])[-MAX_CELLS]
        at = np.flatnonzero(mask)
        found, foreign = self._restricted(shift, known, look, at)
        if foreign or not found[:, 2].any():
            return TractionField(traction, self.x_mm, self.y_mm, 0.0)
        traction.reshape(-1, 3)[at] = found
        whole_view = np.zeros(self.shape)
        whole_view[self._inner] = known
        pressure = traction[..., 2]
        cover = float((whole_view * pressure).sum() / pressure.sum())
        return TractionField(traction, self.x_mm, self.y_mm, cover)

    def sunk_mm(self, press: TractionField) -> Array:
        """How deep the view's cells sank, (len(seen_y_mm), len(seen_x_mm)) float32."""
        at = np.flatnonzero(press.traction_mpa.any(axis=-1))
        columns = (3 * at[:, None] + np.arange(3)).ravel()
        t = press.traction_mpa.reshape(-1)[columns].astype(np.float32)
        return -(t @ self._sinks[columns]).reshape(len(self.seen_y_mm), len(self.seen_x_mm))

    def _restricted(self, shift: Array, known: Array, look: Array, at: Array) -> tuple[Array, bool]:
        """Traction (n, 3) of the cells at those places, and whether it leaves too much over."""
        columns = (3 * at[:, None] + np.arange(3)).ravel()
        told = self._told[columns]
        gram = self._gram[columns].take(columns, axis=1).astype(float)
        seen = np.where(known[..., None], shift, 0).ravel()
        if not known.all():
            lost = told.take(np.flatnonzero(np.repeat(~known.ravel(), 2)), axis=1).astype(float)
            gram -= lost @ lost.T
        right = (told @ seen.astype(np.float32)).astype(float)
        largest = float(np.abs(shift).max())
        weight = 1 + (NOISE_MM / (MODEL * largest)) ** 2
        rough = _roughness(at, self.shape)
        share = np.maximum(look.ravel()[at], 0) / look.max() + LEAST
        for i, kind in enumerate(("shear", "shear", "pressure")):
            gram[i::3, i::3] += weight * (ROUGH[kind] * rough + np.diag(LITTLE[kind] / share))
        signed = np.tile([False, False, True], len(at))
        t = least_squares_signed(gram, right, signed)
        rest = seen - np.where(np.repeat(known.ravel(), 2), t.astype(np.float32) @ told, 0)
        noise2 = 2 * np.count_nonzero(known) * (2 * NOISE_MM) ** 2
        return t.reshape(-1, 3), bool(rest @ rest > noise2 + FOREIGN**2 * (seen @ seen))

    def _cells(self, flow: FaceFlow) -> tuple[Array, Array]:
        """Mean shift of the view's cells (ny, nx, 2), and which are at least half known."""
        flow = whole(flow)
        over_x = _overlap(flow.x_mm, self.seen_x_mm)
        over_y = _overlap(flow.y_mm, self.seen_y_mm)
        known = np.ones((len(self.seen_y_mm), len(self.seen_x_mm)), bool)
        if not flow.known.all():
            known = over_y @ flow.known @ over_x.T >= 0.5
        shift = np.stack([over_y @ flow.shift_mm[..., i] @ over_x.T for i in (0, 1)], axis=-1)
        return shift, known

    def _first_look(self, rows: Array) -> tuple[Array, Array]:
        """Matrix (cells, 2 seen) from shifts to pressure, and what noise adds (cells)."""
        x, y = (grid.ravel() for grid in np.meshgrid(self.x_mm, self.y_mm))
        far2 = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2
        near = np.exp(-far2 / (2 * FIRST["reach_mm"] ** 2))
        pressure = FIRST["pressure"] ** 2 * (near @ rows[:, 2::3].T)
        both = rows[:, 2::3] @ pressure
        for i in (0, 1):
            both += FIRST["shear"] ** 2 * (rows[:, i::3] @ (near @ rows[:, i::3].T))
        both[np.diag_indices_from(both)] += FIRST["error_mm"] ** 2
        first = -linalg.solve(both, pressure.T, assume_a="pos", overwrite_a=True).T
        # An error that is the same over some millimetres goes through as the worst.
        x, y = (grid.ravel() for grid in np.meshgrid(self.seen_x_mm, self.seen_y_mm))
        far2 = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2
        alike = np.exp(-far2 / (2 * FIRST["reach_mm"] ** 2))
        variance = sum(
            np.einsum("cs,cs->c", first[:, i::2] @ alike, first[:, i::2]) for i in (0, 1)
        )
        floor = FLOOR * NOISE_MM * np.sqrt(variance).reshape(self.shape)
        return first.astype(np.float32), floor


def inverse_for(view: SensorModel) -> FaceInverse:
    """The inverse for a sensor, made once in a process. Raises as FaceInverse."""
    return _inverse(SensorModel(view.camera, view.skin, view.poisson))


_inverse = lru_cache(maxsize=4)(FaceInverse)


def _window(
    cells: FaceCells, y: tuple[float, float], x: tuple[float, float]
) -> tuple[slice, slice]:
    """Rows and columns of the cells that lie wholly within limits."""
    cuts = []
    for at, (low, high) in ((cells.y_mm, y), (cells.x_mm, x)):
        half = (at[1] - at[0]) / 2
        inside = np.flatnonzero((at - half >= low - 1e-9) & (at + half <= high + 1e-9))
        cuts.append(slice(int(inside[0]), int(inside[-1]) + 1))
    return cuts[0], cuts[1]


def _overlap(points_mm: Array, cells_mm: Array) -> Array:
    """Weights (cells, points) of the mean over each cell, of points that stand for cells of theirs.

    Rows add up to 1 where the points' cells reach as far as the cell.
    """
    a, b = (points_mm[1] - points_mm[0]) / 2, (cells_mm[1] - cells_mm[0]) / 2
    low = np.maximum(points_mm - a, cells_mm[:, None] - b)
    high = np.minimum(points_mm + a, cells_mm[:, None] + b)
    both = np.maximum(high - low, 0)
    return np.asarray(both / both.sum(axis=1, keepdims=True))


def _around(mask: Array) -> Array:
    """The mask and AROUND cells about it."""
    return np.asarray(
        ndimage.binary_dilation(mask, iterations=AROUND, structure=np.ones((3, 3), bool))
    )


def _roughness(at: Array, shape: tuple[int, int]) -> Array:
    """Matrix (n, n) of the squared differences between neighbours, 0 being beyond the cells."""
    number = np.full((shape[0] + 2, shape[1] + 2), -1)
    row, column = np.divmod(at, shape[1])
    number[row + 1, column + 1] = np.arange(len(at))
    found = np.diag(np.full(len(at), 4.0))
    for down, right in ((0, 1), (2, 1), (1, 0), (1, 2)):
        beside = number[row + down, column + right]
        here = np.flatnonzero(beside >= 0)
        found[here, beside[here]] -= 1
    return found


def least_squares_signed(matrix: Array, right: Array, signed: Array) -> Array:
    """The t (n,) that makes t' matrix t / 2 - right' t least, with t <= 0 where signed (n,) bool.

    matrix (n, n): symmetric, positive definite.
    """
    # Those without a sign go first and once; the search is then among the others only.
    a, b = np.flatnonzero(~signed), np.flatnonzero(signed)
    lower = linalg.cholesky(matrix[np.ix_(a, a)], lower=True, overwrite_a=True, check_finite=False)
    both = np.column_stack((matrix[np.ix_(a, b)], right[a]))
    both = linalg.solve_triangular(lower, both, lower=True, overwrite_b=True, check_finite=False)
    across, known = both[:, :-1], both[:, -1]
    t = np.empty(len(right))
    rest = linalg.cholesky(matrix[np.ix_(b, b)] - across.T @ across, lower=True, overwrite_a=True)
    aim = linalg.solve_triangular(rest, across.T @ known - right[b], lower=True)
    t[b] = -optimize.nnls(rest.T, aim)[0]
    t[a] = linalg.solve_triangular(
        lower, known - across @ t[b], lower=True, trans="T", check_finite=False
    )
    return t


_SUMS = ("Fx/E mm2", "Fy/E mm2", "Fz/E mm2", "Tx/E mm3", "Ty/E mm3", "Tz/E mm3")
_PLACED = ("Fx r2/E mm4", "Fy r2/E mm4", "Fz r2/E mm4")


class Inverse(Features):
    """Sums and moments of the inverse's traction: two factors a force, two a tilting torque.

    A force's second factor goes with the square of its distance from the centre: the centre gives
    some 3 % more than a place 8 mm off it. It is held at 0 as by a press of twenty states whose
    factor is known to 2 %. The traction is not in the resting face, so shear has an arm: a torque
    about x takes the force along y too, and one about y that along x.
    """

    name = "inverse-placed"
    rests_on_gel = local = True
    names = _SUMS + _PLACED
    held = dict.fromkeys(_PLACED, 130.0)  # in mm2
    explains = {  # noqa: RUF012
        "fx": ("Fx/E mm2", "Fx r2/E mm4"),
        "fy": ("Fy/E mm2", "Fy r2/E mm4"),
        "fz": ("Fz/E mm2", "Fz r2/E mm4"),
        "tx": ("Tx/E mm3", "Fy/E mm2"),
        "ty": ("Ty/E mm3", "Fx/E mm2"),
        "tz": ("Tz/E mm3",),
    }

    def __init__(self, view: SensorModel) -> None:
        self.view = view

    @cached_property
    def inverse(self) -> FaceInverse:
        """The solver for the traction; made on first use."""
        return inverse_for(self.view)

    def of(self, flow: FaceFlow) -> Array:
        """(9,): force and torque for a modulus of 1 MPa, and force times the place's r^2."""
        press = self.inverse.of(flow)
        force, centre = press.force_n, press.centre_mm()
        return np.concatenate((force, press.torque_nmm, force * (centre @ centre)))

    def cover(self, flow: FaceFlow) -> float:
        """Share of what presses on the face whose motion is known."""
        return self.inverse.of(flow).cover

    def traction(self, flow: FaceFlow, model: ForceModel) -> TractionField:
        """The inverse's traction, scaled by a model so that its total is the model's force.

        Pressure is scaled as a whole. Shear takes the factor of its own total, and what the model
        says beyond that goes with the pressure, as friction would.
        """
        raw = self.inverse.of(flow)
        total = model.predict(self.of(flow)[None])[0, :3]
        if not raw.pressed:
            return raw
        share = raw.traction_mpa[..., 2] / raw.force_n[2]
        own = model.coefficients[:2, :2].diagonal()
        field = np.empty_like(raw.traction_mpa)
        field[..., 2] = share * total[2]
        field[..., :2] = raw.traction_mpa[..., :2] * own
        field[..., :2] += share[..., None] * (total[:2] - own * raw.force_n[:2])
        return replace(raw, traction_mpa=field)
