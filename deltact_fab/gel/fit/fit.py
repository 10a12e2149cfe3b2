"""Modulus and friction of a lab's own gel, from a measured press.

Model: the hyperelastic curve of the very block and indenter; after a move in plane the whole path
is solved, since friction remembers it. Forces are linear in the modulus; friction is interpolated
between solved coefficients. Least squares with constant noise; the intervals are Student's t on
the covariance s^2 (J'J)^-1, widened where the residuals follow each other.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...aliases import Field, Mask, Point2, Progress
from ...elasticity.material import unusual
from ...errors import InputError, RunFailed
from ...shapes import Indenter, SkinDimensions
from ..level_selection import SHARE, TOLERANCE
from .force_curve import DEEPEST, cells_mm
from .least_squares import (
    WIDER,
    Bounds,
    Estimate,
    FitSolution,
    best_touch,
    own_share,
    smooth_part,
    solve,
)
from .measured import MeasuredIndentation, before_drag
from .press_model import PressModel

ASSUMED_FRICTION = 0.5
COARSER = 1.5
CELLS_REL = SHARE * TOLERANCE  # of the force: what cells by the default tolerance may be off
MODEL_REL = 0.01  # of the force: what the model itself may be off
WIDEST = 0.5  # of friction: half an interval from which it counts as not determined
TOUCHED = 0.02  # of the largest force, for a first guess of the first touch
BEFORE, AFTER = 0.4, 0.15  # of the press, round that guess
MIN_SPREAD = 0.1  # of the deepest press: range of the depths


@dataclass(frozen=True, eq=False)
class GelFit:
    """What a measured press says of the gel.

    friction: None where it was given or is not determined; friction_used: what the model took.
    offset_mm: depth_mm at first touch, None where it was not fitted. rms_n, rms_rel: of all
    residuals, over the rms of the forces. mesh_error_rel: of the modulus, from a mesh COARSER as
    coarse, part of its interval; None where it was not asked for. trend_rel: rms of the smooth
    part of the normal residual over the rms force. depth_mm (p,) from first touch and channel (p,)
    (0 normal, 1 x, 2 y) of measured_n (p,) and model_n (p,); used (p,): False where a value
    was left out as an outlier.
    """

    modulus_mpa: Estimate
    friction: Estimate | None
    friction_used: float
    offset_mm: Estimate | None
    rms_n: float
    rms_rel: float
    trend_rel: float
    mesh_error_rel: float | None
    points: int
    spacing_mm: float
    notes: tuple[str, ...]
    depth_mm: Field
    channel: NDArray[np.int64]
    measured_n: Field
    model_n: Field
    used: Mask

    def as_dict(self) -> dict[str, Any]:
        """The keys of `gel fit --json`."""
        return {
            "modulus_mpa": asdict(self.modulus_mpa),
            "friction": asdict(self.friction) if self.friction else None,
            "friction_used": self.friction_used,
            "offset_mm": asdict(self.offset_mm) if self.offset_mm else None,
            "rms_n": self.rms_n,
            "rms_rel": self.rms_rel,
            "trend_rel": self.trend_rel,
            "mesh_error_rel": self.mesh_error_rel,
            "points": self.points,
            "model": "hyperelastic",
            "spacing_mm": self.spacing_mm,
            "notes": list(self.notes),
        }


def fit_press(
    data: MeasuredIndentation,
    skin: SkinDimensions,
    indenter: Indenter,
    at_mm: Point2 = (0.0, 0.0),
    poisson: float = 0.49,
    friction: float | None = None,
    *,
    fit_friction: bool | None = None,
    fit_offset: bool = False,
    spacing_mm: float | None = None,
    mesh_error: bool = True,
    progress: Progress | None = None,
) -> GelFit:
    """Fit the modulus, and friction and the depth of first touch where asked for.

    friction: taken as known; None: ASSUMED_FRICTION. fit_friction None: fitted where the file has
    side forces of a drag and no friction was given. mesh_error: solve on the coarser mesh too.
    Raises InputError where the file's depths do not fit the gel or are all one, RunFailed where no
    modulus follows or its interval holds 0, and what the engine raises.
    """
    notes: list[str] = []
    known = ASSUMED_FRICTION if friction is None else friction
    looks = (data.has_tangential and friction is None) if fit_friction is None else fit_friction
    bounds, deepest = _reach(data, skin, fit_offset)
    moved = np.vstack([np.zeros((1, 2)), data.shear_mm[data.sheared]])
    tips = np.column_stack([np.array(at_mm) + moved, np.full(len(moved), deepest)])
    asked = cells_mm(skin, indenter, poisson, tips)
    h = asked if spacing_mm is None else spacing_mm

    def model(what: MeasuredIndentation, spacing: float, touch_mm: float) -> PressModel:
        return PressModel(
            what, skin, indenter, at_mm, poisson, deepest, spacing, touch_mm, progress
        )

    touch = 0.0
    if bounds is not None:
        # The path of a drag is solved at one first touch, which the press before it tells.
        press = before_drag(data)
        alone = model(press, h, 0.0)
        touch = best_touch(alone, known, bounds)
        if press is not data:
            touch = solve(alone, known, bounds).touch_mm
    fine = model(data, h, touch)
    solution = solve(fine, None if looks else known, bounds)
    estimate = None
    if looks:
        why = _undetermined(solution)
        if why is None:
            estimate = solution.estimate("friction")
        else:
            without, much = (solve(fine, mu, bounds).values[0] for mu in (0.0, 1.0))
            solution = solve(fine, known, bounds)
            notes.append(
                f"friction is not determined by these data ({why}): {known:g} is assumed; the "
                f"modulus is {without:.4g} MPa with 0 and {much:.4g} MPa with 1; a drag of some "
                "mm, until the side force stays level, determines it"
            )
    coarse = model(data, h * COARSER, touch)
    error = None
    if mesh_error:
        # One pair of meshes may agree by chance: never less than what the cells were chosen for.
        error = max(_mesh_error(fine, coarse, solution, bounds), CELLS_REL * (h / asked) ** 2)
    residual = fine.measured_n - solution.model_n
    used = solution.used
    scale = float(np.sqrt(np.mean(fine.measured_n[used] ** 2)))
    rms = float(np.sqrt(np.mean(residual[used] ** 2)))
    trend, told = _trend(data, fine, solution, residual, scale)
    modulus = solution.estimate("modulus").widened(error or 0.0)
    if not modulus.low > 0:
        raise RunFailed(
            f"gel fit: {modulus.value:.3g} MPa with an interval of {modulus.low:.3g} to "
            f"{modulus.high:.3g}, which holds 0: these data give no modulus; less noise, more rows "
            "or a deeper press is needed"
        )
    notes += told + _remarks(data, solution, modulus, bounds)
    return GelFit(
        modulus_mpa=modulus,
        friction=estimate,
        friction_used=solution.friction,
        offset_mm=solution.estimate("touch") if bounds is not None else None,
        rms_n=rms,
        rms_rel=rms / scale,
        trend_rel=trend,
        mesh_error_rel=error,
        points=int(used.sum()),
        spacing_mm=h,
        notes=tuple(notes),
        depth_mm=data.depth_mm[fine.rows] - solution.touch_mm,
        channel=fine.channel,
        measured_n=fine.measured_n,
        model_n=solution.model_n,
        used=used,
    )


def _reach(
    data: MeasuredIndentation, skin: SkinDimensions, fit_offset: bool
) -> tuple[Bounds | None, float]:
    """Bounds of the depth_mm of first touch, if it is fitted, and the deepest press they need."""
    least, most = float(data.depth_mm.min()), float(data.depth_mm.max())
    # At one depth a force gives no more than one number, whatever it means.
    if not most - least >= MIN_SPREAD * most:
        raise InputError(
            f"{data.name}: column depth_mm: all rows are {least:.3g} to {most:.3g} mm deep; depths "
            f"spread over at least {MIN_SPREAD:.0%} of the deepest are needed"
        )
    limit = DEEPEST * skin.thickness_mm
    bounds: Bounds | None = None
    deepest = most
    if fit_offset:
        level = TOUCHED * float(data.normal_n.max())
        guess = float(data.depth_mm[data.normal_n > level].min())
        press = most - guess
        low = max(guess - BEFORE * press, most - limit)
        bounds = (low, guess + AFTER * press)
        deepest = most - low
        if not low < bounds[1]:
            deepest = press
    if not 0 < deepest <= limit * (1 + 1e-9):
        raise InputError(
            f"{data.name}: column depth_mm: a press of {deepest:g} mm; above 0 and up to "
            f"{limit:g} mm, {DEEPEST:.0%} of the gel's thickness, is needed"
        )
    return bounds, min(deepest, limit)


def _undetermined(solution: FitSolution) -> str | None:
    """Why friction does not follow from the data, or None."""
    found = solution.estimate("friction")
    half = found.high - found.value
    share = own_share(solution, "friction") * WIDEST * max(found.value, 0.1)
    if not WIDER[0] + 1e-3 < found.value < WIDER[-1] * 0.99:
        return f"the best value is at the end of the range {WIDER[0]:g} to {WIDER[-1]:g}"
    if share < MODEL_REL:
        return f"half as much of it changes the forces by {share:.1%}, within the model's error"
    if half > WIDEST * found.value:
        return f"its interval is {found.low:.2g} to {found.high:.2g}"
    return None


def _mesh_error(
    fine: PressModel, coarse: PressModel, solution: FitSolution, bounds: Bounds | None
) -> float:
    """Relative error of the modulus by the mesh, for cells of second order."""
    mu = min(solution.coefficients, key=lambda c: abs(c - solution.friction))
    a, b = (solve(m, mu, bounds).values[0] for m in (fine, coarse))
    return abs(float(b / a) - 1) / (COARSER**2 - 1)


def _trend(
    data: MeasuredIndentation,
    fine: PressModel,
    solution: FitSolution,
    residual: Field,
    scale: float,
) -> tuple[float, list[str]]:
    """Smooth part of the normal residual over depth, relative, and what it means."""
    press = solution.used & (fine.channel == 0) & (data.depth_mm[fine.rows] > solution.touch_mm)
    if not press.any():
        return 0.0, []
    smooth, chance = smooth_part(data.depth_mm[fine.rows][press], residual[press])
    size = float(np.sqrt(np.mean(smooth**2))) / scale
    if chance > 0.001 or size < MODEL_REL:
        return size, []
    return size, [
        f"warning: the residual has a trend over depth of {size:.1%} of the force: thickness, "
        "indenter, position or the depth of first touch (--offset fit) may be wrong, or the gel "
        "creeps"
    ]


def _remarks(
    data: MeasuredIndentation, solution: FitSolution, modulus: Estimate, bounds: Bounds | None
) -> list[str]:
    notes = []
    if odd := unusual(modulus.value):
        notes.append(f"warning: {odd}; normal_n in N (not mN or g) and depth_mm in mm are needed")
    out = int((~solution.used).sum())
    if out:
        notes.append(f"{out} of {len(solution.used)} values left out as outliers")
    if solution.follow:
        notes.append(
            f"residuals follow each other (lag-1 correlation {solution.follow:.2f}); intervals are "
            f"widened {math.sqrt((1 + solution.follow) / (1 - solution.follow)):.1f} times for it"
        )
    if bounds is not None:
        edge = 1e-3 * (bounds[1] - bounds[0])
        if not bounds[0] + edge < solution.touch_mm < bounds[1] - edge:
            notes.append(
                f"warning: the first touch is at the end of its range, {bounds[0]:.3g} to "
                f"{bounds[1]:.3g} mm; rows before touch would determine it"
            )
    away = data.normal_n[data.depth_mm < solution.touch_mm]
    if len(away) > 3:
        bias, doubt = float(away.mean()), float(away.std(ddof=1)) / math.sqrt(len(away))
        if abs(bias) > 4 * doubt and abs(bias) > 1e-3 * float(data.normal_n.max()):
            notes.append(f"warning: the sensor reads {bias:.3g} N before touch; tare it")
    return notes
