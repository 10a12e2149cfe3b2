"""Force from the traction on the face, by inverting the linear operator of the free-sided block.

The flow has two numbers per point and traction three, and a bonded gel hides a uniform pressure: an
unconstrained inverse explains a press by shear. So there are two steps (decision 0024). The coarse
one, precomputed, estimates pressure over the whole view, with shear held small. The restricted one
keeps to the cells around it, with pressure never negative and little shear at little pressure.

Tractions are for a Young's modulus of 1 MPa. Their total is the force up to the modulus and a few
percent of nonlinearity, so a calibration fits a factor per force, which may vary a little with the
place.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np
from scipy import linalg, ndimage, optimize

from deltact_fab.common import Array, InputError
from deltact_fab.sensor import CameraModel, FaceCells, axes_mm

from ..face import FaceFlow, fill_unknown
from ..sensor_id import SensorModel
from .model import Features, ForceModel, TractionField

DIFFERENCE_MM = 1e-3  # of central differences; by hand: rounding below, curvature above


def image_jacobian(camera: CameraModel, x_mm: Array, y_mm: Array) -> Array:
    """Image shift per displacement at resting points x_mm (nx,), y_mm (ny,): (ny, nx, 2, 3).

    In mm of the resting face per mm. For a pinhole it is u_xy - (x, y) u_z / (n eye distance):
    off the axis, depth is seen as motion.
    """
    points = np.stack((*np.meshgrid(x_mm, y_mm), np.zeros((len(y_mm), len(x_mm)))), axis=-1)
    steps = DIFFERENCE_MM * np.eye(3)
    shifts = [camera.project_px(points + u) - camera.project_px(points - u) for u in steps]
    return np.stack(shifts, axis=-1) * (camera.mm_per_px / (2 * DIFFERENCE_MM))


# Decision 0024; weights by hand, chosen on ten presses and measured on others in
# docs/evidence/force.md: ten times weaker ones give pressure off by 0.36 of its peak.
INVERSE_CELL_MM = 1.0
VIEW_MARGIN_MM = 2.0  # a contact may extend beyond the view
SHIFT_NOISE_MM = 0.002  # rms error of a cell's shift: 0.05 px of the paper's camera
MODEL_ERROR = 0.02  # of linear elasticity, over the largest shift
COARSE_PRIOR = {"pressure": 0.1, "shear": 0.015, "reach_mm": 1.5, "error_mm": 0.01}
CONTACT_THRESHOLD = 0.25  # of the coarse peak: cells of the contact
CONTACT_MARGIN = 2  # cells around them
MAX_CONTACT_CELLS = 300
ROUGH_WEIGHT = {"pressure": 3e-3, "shear": 1.5e-2}
SIZE_WEIGHT = {"pressure": 3e-4, "shear": 7e-3}
MIN_CELL_SHARE = 0.05  # of the coarse peak, for cells without coarse pressure
MAX_MISFIT_SHARE = 0.55  # residual over the shift's size, beyond noise: no press explains it
NOISE_FACTOR = 5.0  # coarse peak over its noise, from which it is a contact


class FaceInverse:
    """Inverse for one sensor: takes seconds to build, then serves every frame; see `inverse_for`.

    Regularisation is weighted by 1 + (SHIFT_NOISE_MM / (MODEL_ERROR x largest shift))^2, which is
    near 1 for all but light presses. Raises InputError for a skin or a Poisson's ratio that the
    model of the free sides does not support.
    """

    def __init__(self, view: SensorModel) -> None:
        cells = FaceCells.from_skin(view.skin, view.poisson, INVERSE_CELL_MM)
        xs, ys = axes_mm(view.camera)
        half = view.camera.mm_per_px / 2
        y_range, x_range = (ys[0] - half, ys[-1] + half), (xs[0] - half, xs[-1] + half)
        view_cells = _cells_within(cells, y_range, x_range)
        margin = round(VIEW_MARGIN_MM / INVERSE_CELL_MM)
        rows, columns = (
            slice(max(cut.start - margin, 0), min(cut.stop + margin, len(centres_mm)))
            for cut, centres_mm in zip(view_cells, (cells.y_mm, cells.x_mm), strict=True)
        )
        inner_rows, inner_columns = view_cells
        self.x_mm, self.y_mm = cells.x_mm[columns], cells.y_mm[rows]
        self.seen_x_mm, self.seen_y_mm = cells.x_mm[inner_columns], cells.y_mm[inner_rows]
        self.cell_mm2 = cells.cell_mm2
        self._inner = (
            slice(inner_rows.start - rows.start, inner_rows.stop - rows.start),
            slice(inner_columns.start - columns.start, inner_columns.stop - columns.start),
        )
        compliance = cells.compliance(view_cells, (rows, columns))
        n = len(self.y_mm) * len(self.x_mm)
        compliance = compliance.reshape(-1, 3, 3 * n)
        # One contiguous row per cell that may be loaded, as a contact takes only some.
        self._sink_response = np.ascontiguousarray(compliance[:, 2].T, np.float32)
        jacobian = image_jacobian(view.camera, self.seen_x_mm, self.seen_y_mm).reshape(-1, 2, 3)
        response = np.matmul(jacobian, compliance).reshape(-1, 3 * n)
        self._response = np.ascontiguousarray(response.T, np.float32)
        self._gram = (response.T @ response).astype(np.float32)
        self._coarse, self._floor = self._coarse_inverse(response)
        self._last: tuple[FaceFlow, TractionField] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells that may be loaded."""
        return len(self.y_mm), len(self.x_mm)

    def solve(self, flow: FaceFlow) -> TractionField:
        """Solve the traction behind a frame's flow; the last solution is cached.

        For a modulus of 1 MPa, on cells of the face: 0 outside the contact, t_z <= 0. cover: share
        of the pressure on cells whose motion is known (none outside the view); without a contact,
        known share of the view; 0, without traction, if no press explains the flow. Raises
        InputError for a flow coarser than the cells.
        """
        last = self._last
        if last is None or last[0] is not flow:
            self._last = last = (flow, self._solve(flow))
        return last[1]

    def _solve(self, flow: FaceFlow) -> TractionField:
        shift, valid = self._cell_shifts(flow)
        traction = np.zeros((*self.shape, 3))
        cover = float(valid.mean())
        coarse = (self._coarse @ shift.ravel().astype(np.float32)).reshape(self.shape)
        certain = coarse > self._floor
        if not certain.any():
            return TractionField(traction, self.x_mm, self.y_mm, cover)
        mask = _dilate(coarse > CONTACT_THRESHOLD * coarse[certain].max())
        if np.count_nonzero(mask) > MAX_CONTACT_CELLS:
            mask &= coarse >= np.sort(coarse[mask])[-MAX_CONTACT_CELLS]
        active = np.flatnonzero(mask)
        solution, foreign = self._fit(shift, valid, coarse, active)
        if foreign or not solution[:, 2].any():
            return TractionField(traction, self.x_mm, self.y_mm, 0.0)
        traction.reshape(-1, 3)[active] = solution
        whole_view = np.zeros(self.shape)
        whole_view[self._inner] = valid
        pressure = traction[..., 2]
        cover = float((whole_view * pressure).sum() / pressure.sum())
        return TractionField(traction, self.x_mm, self.y_mm, cover)

    def indentation_mm(self, press: TractionField) -> Array:
        """Depth of the view's cells under a traction, (len(seen_y_mm), len(seen_x_mm)) float32."""
        active = np.flatnonzero(press.traction_mpa.any(axis=-1))
        columns = (3 * active[:, None] + np.arange(3)).ravel()
        t = press.traction_mpa.reshape(-1)[columns].astype(np.float32)
        return -(t @ self._sink_response[columns]).reshape(len(self.seen_y_mm), len(self.seen_x_mm))

    def _fit(self, shift: Array, valid: Array, coarse: Array, active: Array) -> tuple[Array, bool]:
        """Solve the traction (n, 3) of the active cells; True if the residual is too large."""
        columns = (3 * active[:, None] + np.arange(3)).ravel()
        response = self._response[columns]
        gram = self._gram[columns].take(columns, axis=1).astype(float)
        data = np.where(valid[..., None], shift, 0).ravel()
        if not valid.all():
            invalid = np.flatnonzero(np.repeat(~valid.ravel(), 2))
            hidden = response.take(invalid, axis=1).astype(float)
            gram -= hidden @ hidden.T
        right = (response @ data.astype(np.float32)).astype(float)
        largest = float(np.abs(shift).max())
        weight = 1 + (SHIFT_NOISE_MM / (MODEL_ERROR * largest)) ** 2
        rough = _roughness_matrix(active, self.shape)
        share = np.maximum(coarse.ravel()[active], 0) / coarse.max() + MIN_CELL_SHARE
        for i, kind in enumerate(("shear", "shear", "pressure")):
            penalty = ROUGH_WEIGHT[kind] * rough + np.diag(SIZE_WEIGHT[kind] / share)
            gram[i::3, i::3] += weight * penalty
        signed = np.tile([False, False, True], len(active))
        t = least_squares_signed(gram, right, signed)
        residual = data - np.where(np.repeat(valid.ravel(), 2), t.astype(np.float32) @ response, 0)
        noise2 = 2 * np.count_nonzero(valid) * (2 * SHIFT_NOISE_MM) ** 2
        limit2 = noise2 + MAX_MISFIT_SHARE**2 * (data @ data)
        return t.reshape(-1, 3), bool(residual @ residual > limit2)

    def _cell_shifts(self, flow: FaceFlow) -> tuple[Array, Array]:
        """Mean shift of the view's cells (ny, nx, 2), and mask of those at least half known."""
        if flow.cell_mm > INVERSE_CELL_MM:
            raise InputError(
                f"a flow at points {flow.cell_mm:.2g} mm apart; at most {INVERSE_CELL_MM:g} mm, "
                "the cells of the inverse"
            )
        flow = fill_unknown(flow)
        over_x = _overlap_weights(flow.x_mm, self.seen_x_mm)
        over_y = _overlap_weights(flow.y_mm, self.seen_y_mm)
        valid = np.ones((len(self.seen_y_mm), len(self.seen_x_mm)), bool)
        if not flow.known.all():
            valid = over_y @ flow.known @ over_x.T >= 0.5
        shift = np.stack([over_y @ flow.shift_mm[..., i] @ over_x.T for i in (0, 1)], axis=-1)
        return shift, valid

    def _coarse_inverse(self, rows: Array) -> tuple[Array, Array]:
        """Matrix (cells, 2 x view cells) from shifts to pressure, and its noise floor (cells)."""
        x, y = (grid.ravel() for grid in np.meshgrid(self.x_mm, self.y_mm))
        distance2 = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2
        near = np.exp(-distance2 / (2 * COARSE_PRIOR["reach_mm"] ** 2))
        pressure = COARSE_PRIOR["pressure"] ** 2 * (near @ rows[:, 2::3].T)
        covariance = rows[:, 2::3] @ pressure
        for i in (0, 1):
            covariance += COARSE_PRIOR["shear"] ** 2 * (rows[:, i::3] @ (near @ rows[:, i::3].T))
        covariance[np.diag_indices_from(covariance)] += COARSE_PRIOR["error_mm"] ** 2
        matrix = -linalg.solve(covariance, pressure.T, assume_a="pos", overwrite_a=True).T
        # Noise correlated over some millimetres, the worst case.
        x, y = (grid.ravel() for grid in np.meshgrid(self.seen_x_mm, self.seen_y_mm))
        distance2 = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2
        correlation = np.exp(-distance2 / (2 * COARSE_PRIOR["reach_mm"] ** 2))
        variance = sum(
            np.einsum("cs,cs->c", matrix[:, i::2] @ correlation, matrix[:, i::2]) for i in (0, 1)
        )
        floor = NOISE_FACTOR * SHIFT_NOISE_MM * np.sqrt(variance).reshape(self.shape)
        return matrix.astype(np.float32), floor


def inverse_for(view: SensorModel) -> FaceInverse:
    """Return the inverse for a sensor, built once per process. Raises as FaceInverse."""
    return _inverse(SensorModel(view.camera, view.skin, view.poisson))


_inverse = lru_cache(maxsize=4)(FaceInverse)


def _cells_within(
    cells: FaceCells, y: tuple[float, float], x: tuple[float, float]
) -> tuple[slice, slice]:
    """Rows and columns of the cells that lie wholly within the limits y and x."""
    cuts = []
    for centres_mm, (low, high) in ((cells.y_mm, y), (cells.x_mm, x)):
        half = (centres_mm[1] - centres_mm[0]) / 2
        below, above = centres_mm - half >= low - 1e-9, centres_mm + half <= high + 1e-9
        inside = np.flatnonzero(below & above)
        cuts.append(slice(int(inside[0]), int(inside[-1]) + 1))
    return cuts[0], cuts[1]


def _overlap_weights(points_mm: Array, cells_mm: Array) -> Array:
    """Weights (cells, points) of the mean over each cell, by overlap with the points' own cells.

    Rows add up to 1.
    """
    a, b = (points_mm[1] - points_mm[0]) / 2, (cells_mm[1] - cells_mm[0]) / 2
    low = np.maximum(points_mm - a, cells_mm[:, None] - b)
    high = np.minimum(points_mm + a, cells_mm[:, None] + b)
    overlap = np.maximum(high - low, 0)
    return np.asarray(overlap / overlap.sum(axis=1, keepdims=True))


def _dilate(mask: Array) -> Array:
    """Dilate the mask by CONTACT_MARGIN cells."""
    return np.asarray(
        ndimage.binary_dilation(mask, iterations=CONTACT_MARGIN, structure=np.ones((3, 3), bool))
    )


def _roughness_matrix(active: Array, shape: tuple[int, int]) -> Array:
    """Matrix (n, n) of the squared differences between neighbours, 0 outside the active cells."""
    number = np.full((shape[0] + 2, shape[1] + 2), -1)
    row, column = np.divmod(active, shape[1])
    number[row + 1, column + 1] = np.arange(len(active))
    laplacian = np.diag(np.full(len(active), 4.0))
    for down, right in ((0, 1), (2, 1), (1, 0), (1, 2)):
        neighbour = number[row + down, column + right]
        inside = np.flatnonzero(neighbour >= 0)
        laplacian[inside, neighbour[inside]] -= 1
    return laplacian


def least_squares_signed(matrix: Array, right: Array, signed: Array) -> Array:
    """Minimize t' matrix t / 2 - right' t over t (n,), with t <= 0 where signed (n,) bool.

    matrix (n, n): symmetric, positive definite.
    """
    # Unsigned unknowns are eliminated first; the search is then over the signed ones only.
    a, b = np.flatnonzero(~signed), np.flatnonzero(signed)
    lower = linalg.cholesky(matrix[np.ix_(a, a)], lower=True, overwrite_a=True, check_finite=False)
    block = np.column_stack((matrix[np.ix_(a, b)], right[a]))
    block = linalg.solve_triangular(lower, block, lower=True, overwrite_b=True, check_finite=False)
    across, right_free = block[:, :-1], block[:, -1]
    t = np.empty(len(right))
    rest = linalg.cholesky(matrix[np.ix_(b, b)] - across.T @ across, lower=True, overwrite_a=True)
    target = linalg.solve_triangular(rest, across.T @ right_free - right[b], lower=True)
    t[b] = -optimize.nnls(rest.T, target)[0]
    t[a] = linalg.solve_triangular(
        lower, right_free - across @ t[b], lower=True, trans="T", check_finite=False
    )
    return t


_INTEGRAL_LABELS = ("Fx/E mm2", "Fy/E mm2", "Fz/E mm2", "Tx/E mm3", "Ty/E mm3", "Tz/E mm3")
_PLACED_LABELS = ("Fx r2/E mm4", "Fy r2/E mm4", "Fz r2/E mm4")


class Inverse(Features):
    """Integrals and moments of the inverse's traction: two factors per force and tilting torque.

    A force's second factor multiplies the square of its distance from the centre: the centre gives
    some 3 % more than a place 8 mm off it. Its prior is 0, as from a press of twenty states whose
    factor is known to 2 %. The traction acts off the resting face, so shear has an arm: a torque
    about x has a term of the force along y, and one about y of that along x.
    """

    name = "inverse-placed"
    rests_on_gel = local = True
    names = _INTEGRAL_LABELS + _PLACED_LABELS
    prior_scales = dict.fromkeys(_PLACED_LABELS, 130.0)  # in mm2
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

    def compute(self, flow: FaceFlow) -> Array:
        """Force and torque for a modulus of 1 MPa, and force times the place's r^2, (9,)."""
        press = self.inverse.solve(flow)
        force, centre = press.force_n, press.centre_mm()
        return np.concatenate((force, press.torque_nmm, force * (centre @ centre)))

    def cover(self, flow: FaceFlow) -> float:
        """Share of the pressure on cells whose motion is known."""
        return self.inverse.solve(flow).cover

    def traction(self, flow: FaceFlow, model: ForceModel) -> TractionField:
        """Scale the inverse's traction so that its total is the model's force.

        Pressure is scaled as a whole. Shear is scaled by its own factor, and the rest of the
        model's shear force is distributed like the pressure, as friction would be.
        """
        raw = self.inverse.solve(flow)
        total = model.predict(self.compute(flow)[None])[0, :3]
        if not raw.pressed:
            return raw
        share = raw.traction_mpa[..., 2] / raw.force_n[2]
        factors = model.coefficients[:2, :2].diagonal()
        field = np.empty_like(raw.traction_mpa)
        field[..., 2] = share * total[2]
        field[..., :2] = raw.traction_mpa[..., :2] * factors
        field[..., :2] += share[..., None] * (total[:2] - factors * raw.force_n[:2])
        return replace(raw, traction_mpa=field)
