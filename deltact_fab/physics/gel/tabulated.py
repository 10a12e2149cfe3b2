"""Finite strain from a table: a press at any place for the cost of a linear one.

The table of a tip is its press in the middle, at the ends of the range along x and y and at its
corner, solved linearly and at finite strain on cells of one size. What finite strain changes is
taken between these places and depths, of the normal force as a ratio and of everything else as a
difference that moves with the tip, and is added to the linear solution of the press itself.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from deltact_fab.common import Field, InputError, Point, Point2
from deltact_fab.sensor import SkinDimensions

from .level import TABULATED_LEVEL, Choice, GelContact, State
from .level_selection import table_half_mm
from .linear.gel import LinearGel, sample_on_lattice
from .path.knots import SolvedKnot
from .path.solver import PathSolver
from .zones import ZoneMap, Zones, hermite

BLEND_POWER = 3.0  # measured, docs/evidence/gel.md: growth from the middle towards the rim
LEAST_WEIGHT = 0.03  # by hand: a place with less is not solved, at a cost of 0.1 % of the force
STRAY_MM = 0.01  # by hand: a press strays by motor steps, and is no drag


@dataclass(frozen=True, eq=False)
class TableNode:
    """Solved press of a table: weight of its place_mm, and its paths at both levels."""

    weight: float
    place_mm: Point2
    finite: PathSolver
    linear: PathSolver


Shares = list[tuple[float, TableNode, SolvedKnot, SolvedKnot]]


def table_weights(skin: SkinDimensions, place_mm: Point2) -> dict[Point2, float]:
    """Weights of the table's places for a press, on its side of the middle."""
    along: list[dict[float, float]] = []
    for position, end in zip(place_mm, table_half_mm(skin), strict=True):
        share = min(abs(position) / end, 1.0) ** BLEND_POWER if end > 0 else 0.0
        along.append({math.copysign(end, position): share, 0.0: 1 - share})
    products = {(x, y): along[0][x] * along[1][y] for x, y in itertools.product(*along)}
    weights = {place: weight for place, weight in products.items() if weight >= LEAST_WEIGHT}
    return {place: weight / sum(weights.values()) for place, weight in weights.items()}


class TabulatedGel(GelContact):
    """Contact of a press at place_mm. linear: the level that solves it; nodes: of the table."""

    level = TABULATED_LEVEL

    def __init__(
        self, choice: Choice, linear: LinearGel, nodes: Sequence[TableNode], place_mm: Point2
    ) -> None:
        self.choice, self._linear, self._nodes, self._place_mm = choice, linear, nodes, place_mm
        self.x_mm, self.y_mm = linear.x_mm, linear.y_mm
        self.dofs = max(node.finite.dofs for node in nodes)
        self._depths_mm = [-pose.tip_mm[2] for pose in nodes[0].finite.poses]

    def rest(self, tip_mm: Point = (0.0, 0.0, 0.0)) -> State:
        return self._state(self._linear.rest(tip_mm))

    def solve(
        self, previous: State, tip_mm: Point, seconds: float = 0.0, guide: None = None
    ) -> State:
        """One increment of the linear level, with the history of that level.

        Raises InputError for a move in plane or below the table.
        """
        x, y, depth = tip_mm
        deepest = self._depths_mm[-1]
        if math.dist((x, y), self._place_mm) > STRAY_MM or depth > deepest + STRAY_MM:
            raise InputError(
                f"gel: level {self.level}: a tip at ({x:g}, {y:g}), {depth:g} mm deep, leaves its "
                f"press to {deepest:g} mm; use level hyperelastic"
            )
        return self._state(self._linear.solve(previous.inner, tip_mm))

    def _shares(self, depth: float) -> Shares:
        """Return share, node, finite and linear knot of the table's presses next to a depth.

        The shares of a light press add up to less than 1, with a rest at depth 0.
        """
        depths = [0.0, *self._depths_mm]
        along = [float(np.interp(depth, depths, row)) for row in np.eye(len(depths))[1:]]
        return [
            (node.weight * share, node, fine, rough)
            for node in self._nodes
            for share, fine, rough in zip(
                along, node.finite.solve_all(), node.linear.solve_all(), strict=True
            )
            if share > 0
        ]

    def _state(self, linear: State) -> State:
        shares = self._shares(linear.tip_mm[2])
        if not shares:
            return State(linear, linear.force_n, linear.torque_nmm, linear.diagnostics, self)
        ratio, arm = mean_ratio(shares), np.array([*linear.tip_mm[:2], 0.0])
        force = ratio * np.array(linear.force_n)
        torque = ratio * (np.array(linear.torque_nmm) - np.cross(arm, linear.force_n))
        for share, node, fine, rough in shares:
            for scale, knot in ((share, fine), (-share * force_ratio(fine, rough), rough)):
                force += scale * np.array(knot.force_n)
                torque += scale * np.array(knot.torque_nmm)
                torque -= scale * np.cross((*node.place_mm, 0.0), knot.force_n)
        (fx, fy, fz), (tx, ty, tz) = force.tolist(), (torque + np.cross(arm, force)).tolist()
        knots = [fine for _, _, fine, _ in shares]
        diagnostics = replace(
            linear.diagnostics,
            penetration_mm=max(knot.penetration_mm for knot in knots),
            most_stretch=max(knot.most_stretch or 1.0 for knot in knots),
            flags=tuple({flag.id: flag for knot in knots for flag in knot.flags}.values()),
        )
        return State(linear, (fx, fy, fz), (tx, ty, tz), diagnostics, self)

    @cached_property
    def _moves(self) -> dict[Point2, tuple[Field, Field]]:
        """Matrices along x and y that move a field of the lattice from a node to the press."""
        moves, x, y = {}, self.x_mm, self.y_mm
        for node in self._nodes:
            dx, dy = np.subtract(self._place_mm, node.place_mm)
            along_x, along_y = np.clip(x - dx, x[0], x[-1]), np.clip(y - dy, y[0], y[-1])
            moves[node.place_mm] = hermite(x, along_x), hermite(y, along_y)
        return moves

    def _change(self, name: str, shares: Shares, scaled: bool) -> Field:
        """Change of a field by finite strain, moved from the table's places.

        scaled: of the linear field times `force_ratio`.
        """
        change: Field = np.zeros((len(self.y_mm), len(self.x_mm), 3))
        for share, node, fine, rough in shares:
            factor = force_ratio(fine, rough) if scaled else 1.0
            part = share * np.subtract(getattr(fine, name), factor * getattr(rough, name))
            change += sample_on_lattice(self._moves[node.place_mm], part.astype(np.float64))
        return change

    def displacement_mm(self, inner: State) -> Field:
        shares = self._shares(inner.tip_mm[2])
        return inner.displacement_mm + self._change("displacement_mm", shares, False)

    def traction_mpa(self, inner: State) -> Field:
        """Return tractions (ny, nx, 3) whose sum is the force; none pulls."""
        shares = self._shares(inner.tip_mm[2])
        field = mean_ratio(shares) * inner.traction_mpa
        field += self._change("traction_mpa", shares, True)
        total = field[..., 2].sum()
        field[..., 2] = np.minimum(field[..., 2], 0.0)
        if total < 0:
            field[..., 2] *= total / field[..., 2].sum()
        return field

    def zones(self, inner: State) -> tuple[Zones, ZoneMap] | None:
        linear, zone_map = inner.zones
        shares = self._shares(inner.tip_mm[2])
        if not linear.contact_area_mm2 or not shares:
            return None
        mixed: dict[str, Any] = {}
        for name, value in vars(linear).items():
            mixed[name] = np.array(value)
            for share, _, fine, rough in shares:
                change = np.subtract(vars(fine.zones)[name], vars(rough.zones)[name])
                mixed[name] = mixed[name] + share * change
        x, y = mixed.pop("centroid_mm").tolist()
        mixed = {name: max(float(value), 0.0) for name, value in mixed.items()}
        mixed["stick_area_mm2"] = min(mixed["stick_area_mm2"], mixed["contact_area_mm2"])
        _, node, fine, _ = max(shares, key=lambda item: item[0])
        if fine.zone_map is not None:
            dx, dy = np.subtract(self._place_mm, node.place_mm)
            sides = (self.y_mm, dy), (self.x_mm, dx)
            nearest = (abs(axis[:, None] - (axis - d)).argmin(axis=0) for axis, d in sides)
            zone_map = fine.zone_map[np.ix_(*nearest)]
        return Zones(**mixed, centroid_mm=(x, y)), zone_map


def force_ratio(fine: SolvedKnot, rough: SolvedKnot) -> float:
    """Normal force at finite strain over that of the linear level."""
    return fine.force_n[2] / rough.force_n[2] if rough.force_n[2] else 1.0


def mean_ratio(shares: Shares) -> float:
    """Mean of `force_ratio` over shares; of a light press the first knots', 1 at rest."""
    total = sum(share for share, *_ in shares)
    ratios = (share * force_ratio(fine, rough) for share, _, fine, rough in shares)
    return sum(ratios) / total if shares else 1.0
