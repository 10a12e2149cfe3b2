"""Candidate presses of a plan, and the features that a linear gel gives for them.

Places are space-filling (Sobol) in a quarter of the reach; a press that is chosen is mirrored into
one of the quarters, as mirror images have the same features but for signs. A press goes to one
depth and is dragged once, short of slipping.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from deltact_fab.common import Array, InputError, Point, Point2, Progress, SolverError
from deltact_fab.physics import Increments, ObservedChannels, choose_level, open_path
from deltact_fab.sensor import (
    MAX_LINEAR_POISSON,
    CameraModel,
    GelMaterial,
    SkinDimensions,
    axes_mm,
    parse_indenter,
)

DEPTH_LEVELS = (0.4, 0.6, 0.8, 1.0)
"""Shares of a tip's largest depth. By hand: a model linear in depth would take the largest alone,
and never show where the gel stiffens; each level gets as many presses as the others."""
SLIP_FACTOR = 1.5  # by Mindlin, paper of 1949: x friction x depth slips fully
DRAG_SHARES = (0.3, 0.45, 0.6)  # of what slips; by hand: from clear of the noise to short of slip
FIT_PLACES, VALIDATION_PLACES = 16, 16  # by hand: more take a second of solving for each depth
QUADRANT_SIGNS = ((1, 1), (-1, -1), (1, -1), (-1, 1))  # definition: signs of x and y
PLACE_STEP_MM = 0.1  # by hand: of places, for a file that is read; rounded inwards
_GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))  # definition: directions that never repeat
_DEPTH_STEP_MM = 0.05  # by hand: of the search for the depth of the largest force
_MIN_DEPTH_MM = 0.1  # by hand: a shallower press is mostly roughness


@dataclass(frozen=True)
class Candidate:
    """A press that may be planned: indenter, place, depth and drag in mm, number of its level."""

    indenter: str
    at_mm: Point2
    depth_mm: float
    drag_mm: Point2
    level: int

    def mirrored(self, quadrant: int) -> Candidate:
        """Mirror into one of the four quadrants; 0 leaves the press where it is."""
        sign_x, sign_y = QUADRANT_SIGNS[quadrant % len(QUADRANT_SIGNS)]
        (x, y), (dx, dy) = self.at_mm, self.drag_mm
        place, drag = (sign_x * x + 0.0, sign_y * y + 0.0), (sign_x * dx + 0.0, sign_y * dy + 0.0)
        return replace(self, at_mm=place, drag_mm=drag)

    def as_dict(self) -> dict[str, float | str]:
        """Return the keys of a protocol's [[press]]."""
        (x, y), (dx, dy) = self.at_mm, self.drag_mm
        return {"indenter": self.indenter, "x_mm": x, "y_mm": y, "depth_mm": self.depth_mm,
                "shear_x_mm": dx, "shear_y_mm": dy}  # fmt: skip


@dataclass(frozen=True)
class GelFeatures:
    """Features of presses on the linear gel of a sensor.

    margin_mm: gel that remains below the deepest press.
    """

    skin: SkinDimensions
    material: GelMaterial
    margin_mm: float

    def wrenches(self, indenter: str, corners_mm: Sequence[Point], partial: bool = False) -> Array:
        """Wrenches (n, 6) on the sensor at the corners (x, y, z) of a path, from the second on.

        partial: return those before a corner that the gel does not reach, instead of its error.
        """
        poisson = min(self.material.poisson, MAX_LINEAR_POISSON)
        material, tip = replace(self.material, poisson=poisson, prony=()), parse_indenter(indenter)
        skin, coarse = self.skin, Increments(math.inf, math.inf).poses(corners_mm)
        choice = choose_level(skin, material, tip, coarse, level="linear")
        poses = Increments(choice.step_mm, choice.step_mm).poses(corners_mm)
        solver = open_path(skin, material, tip, poses, ObservedChannels(), choice)
        try:
            solver.solve_all()
        except (InputError, SolverError):
            if not partial:
                raise
        knots = zip(poses, solver.knots, strict=False)
        ends = [knot.wrench for pose, knot in knots if pose.part == 1]
        return self.material.modulus_mpa * np.array(ends).reshape(-1, 6)

    def features(self, press: Candidate) -> Array:
        """Features (2, 9) of the model `inverse-placed` in N: of the press and of its drag's end.

        Force, torque, and force times the square of the distance of its centre from the middle.
        """
        (x, y), z, (dx, dy) = press.at_mm, -press.depth_mm, press.drag_mm
        rows = self.wrenches(press.indenter, [(x, y, 0.0), (x, y, z), (x + dx, y + dy, z)])
        force, torque = rows[:, :3], rows[:, 3:]
        distance2 = (torque[:, :2] ** 2).sum(axis=1) / force[:, 2] ** 2
        return np.concatenate((rows, force * distance2[:, None]), axis=1)

    def largest_depth_mm(self, indenter: str, range_n: float) -> float:
        """Depth at which a tip in the middle presses with range_n, as far as the gel allows.

        Raises InputError for a range that no press of use is within.
        """
        tip, skin = parse_indenter(indenter), self.skin
        deepest_mm = min(
            skin.thickness_mm - self.margin_mm, skin.thickness_mm / 4,
            tip.reach_mm, tip.equator_mm - _DEPTH_STEP_MM,
        )  # fmt: skip
        depths = np.arange(1, math.floor(deepest_mm / _DEPTH_STEP_MM + 1e-9) + 1) * _DEPTH_STEP_MM
        corners: list[Point] = [(0.0, 0.0, 0.0), *((0.0, 0.0, -d) for d in depths.tolist())]
        forces = -self.wrenches(indenter, corners, partial=True)[:, 2]
        depths = depths[: len(forces)]
        depth_mm = float(np.interp(range_n, [0.0, *forces], [0.0, *depths]))
        if depth_mm * DEPTH_LEVELS[0] < _MIN_DEPTH_MM:
            least_n = float(np.interp(_MIN_DEPTH_MM / DEPTH_LEVELS[0], depths, forces))
            raise InputError(
                f"--range {range_n:g} N: {indenter} reaches it {depth_mm:.2f} mm deep; "
                f"at least {least_n:.2g} N, or a smaller tip"
            )
        return depth_mm


def spread_candidates(
    gel: GelFeatures, tips: Sequence[str], range_n: float, view: CameraModel, seed: int,
    places: int | None = None,
) -> tuple[list[Candidate], list[Candidate]]:  # fmt: skip
    """Spread candidates over tips, places and depths: those to fit, and others to validate.

    All are in one quadrant; their places differ, FIT_PLACES and VALIDATION_PLACES by default.
    Raises InputError for a tip without room.
    """
    deepest = {tip: gel.largest_depth_mm(tip, range_n) for tip in tips}
    slip_share = SLIP_FACTOR * gel.material.friction
    reach_mm = np.min([_reach_mm(gel, tip, deepest[tip], view) for tip in tips], axis=0)
    count = places or FIT_PLACES + VALIDATION_PLACES
    folded = qmc.Sobol(2, seed=np.random.default_rng(seed)).random(count) * reach_mm
    parts: list[list[Candidate]] = [[], []]
    for k, place in enumerate(np.floor(folded / PLACE_STEP_MM) * PLACE_STEP_MM):
        x, y = np.round(place, 1).tolist()
        for tip, (level, share) in itertools.product(tips, enumerate(DEPTH_LEVELS)):
            depth_mm = round(share * deepest[tip], 2)
            angle = _GOLDEN_ANGLE * (k * len(DEPTH_LEVELS) + level)
            drag_mm = DRAG_SHARES[(k + level) % len(DRAG_SHARES)] * slip_share * depth_mm
            drag = round(drag_mm * math.cos(angle), 2), round(drag_mm * math.sin(angle), 2)
            parts[k >= FIT_PLACES].append(Candidate(tip, (x, y), depth_mm, drag, level))
    return parts[0], parts[1]


def _reach_mm(gel: GelFeatures, tip: str, depth_mm: float, view: CameraModel) -> Array:
    """Largest |x| and |y| (2,) of a tip: footprint on the face, contact in the camera's view."""
    drag_mm = DRAG_SHARES[-1] * SLIP_FACTOR * gel.material.friction * depth_mm
    footprint_mm = np.array(parse_indenter(tip).footprint_half_mm)
    face_mm = np.array(gel.skin.opening_half_mm) - footprint_mm
    # A contact of a ball has a^2 = R d (Hertz); that of a flat tip is its footprint.
    contact_mm = np.minimum(footprint_mm, np.sqrt(footprint_mm * depth_mm))
    half_mm = np.array([np.abs(axis).max() for axis in axes_mm(view)])
    reach_mm: Array = np.minimum(face_mm, half_mm - contact_mm) - drag_mm - PLACE_STEP_MM / 10
    if reach_mm.min() <= 0:
        raise InputError(f"--tip {tip}: no room on this face and in this view; use a smaller tip")
    return reach_mm


def solve_features(
    gel: GelFeatures, candidates: Sequence[Candidate], progress: Progress | None = None
) -> Array:
    """Solve the features (m, 2, 9) of candidates, see `GelFeatures.features`."""
    out = np.empty((len(candidates), 2, 9))
    for k, candidate in enumerate(candidates):
        out[k] = gel.features(candidate)
        if progress:
            progress(k + 1, len(candidates), f"{candidate.indenter} on a linear gel")
    return out
