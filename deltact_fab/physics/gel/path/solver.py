"""A press solved knot by knot: each is read from the store, or solved and then stored."""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import DeltactFabError, Field, InputError, Note, Point, SolverError, Store

from .knots import KnotPose, Mirror, ObservedChannels, SolvedKnot

if TYPE_CHECKING:
    from ..level import Choice, GelContact, State

KnotProgress = Callable[[int, int, float], None]  # knots done, of all, seconds of the last

SOLVED_PATHS = Store("gel-trajectory", limit_bytes=8 * 10**9)
UNKEPT_FIELDS: dict[str, Any] = dict.fromkeys(("displacement_mm", "traction_mpa", "zone_map"))
END_ERRORS: dict[str, type[DeltactFabError]] = {"input": InputError, "solver": SolverError}


class PathSolver:
    """Knots of one press: key 0 is rest, 1 to len(poses) are the planned knots, then others.

    contact: opens the contact at the first solve, for a modulus of 1 MPa. key: of the store; None
    stores nothing. mirror: from the press to its image that is solved and stored; everything else
    here is of the press itself. floor_mm: depth of the gel's floor. stored: the store's entry, if
    any. solves, seconds: of knots solved here, without stored ones. A press that fails is stored up
    to there with the error and not tried again. coarser: solver of the same path on a coarser mesh;
    if it keeps its states (keeps_states), this one starts from them. choice: set by the opener.
    """

    choice: Choice

    def __init__(
        self,
        contact: Callable[[], GelContact],
        planned: Sequence[KnotPose] = (),
        key: dict[str, Any] | None = None,
        observed: ObservedChannels | None = None,
        mirror: Mirror | None = None,
        floor_mm: float = math.inf,
        coarser: PathSolver | None = None,
        keeps_states: bool = False,
    ) -> None:
        self.states: list[State] = []
        self._keeps_states, self._coarser, self._guide = keeps_states, coarser, None
        self.poses, self.observed = tuple(planned), observed or ObservedChannels()
        self._floor_mm = floor_mm
        self.mirror = mirror or Mirror()
        self._open = contact
        self._contact: GelContact | None = None
        self._key = key
        self._knots: list[SolvedKnot] = []
        self._states: dict[int, State] = {}
        self._last_key = len(self.poses)
        self._closed = False
        self.solves, self.seconds = 0, 0.0
        self.stored = self._load()

    @property
    def contact(self) -> GelContact:
        if self._contact is None:
            self._contact = self._open()
        return self._contact

    @property
    def axes_mm(self) -> tuple[Field, Field]:
        if self.stored is not None:
            return self.stored["x_mm"], self.stored["y_mm"]
        return self.contact.x_mm, self.contact.y_mm

    @property
    def dofs(self) -> int:
        return int(self.stored["dofs"]) if self.stored else self.contact.dofs

    @property
    def stored_as(self) -> str | None:
        """Identifier, equal for presses that share a solution; None: nothing is stored."""
        return None if self._key is None else json.dumps(self._key)

    @property
    def stored_file(self) -> Path | None:
        """The store's file of the complete press, None if missing."""
        return None if self._key is None else SOLVED_PATHS.file(self._key)

    @property
    def knots(self) -> tuple[SolvedKnot, ...]:
        return tuple(self._knots)

    @property
    def last(self) -> SolvedKnot:
        return self._knots[-1]

    @property
    def ended(self) -> str:
        """Error that prevents the planned knots after the stored ones; empty if none."""
        return str(self.stored["ended"][1]) if self.stored and self.stored["ended"] else ""

    @property
    def flags(self) -> dict[str, int]:
        """Count these knots' flags by id."""
        return dict(sorted(Counter(flag.id for knot in self._knots for flag in knot.flags).items()))

    def next(self, previous: int, tip_mm: Point, seconds: float) -> SolvedKnot:
        """Solve the knot at tip (x, y, z < 0), straight from the knot of key `previous`.

        seconds: duration; a planned knot uses the plan's. Raises SolverError and InputError when
        the gel cannot be solved there.
        """
        assert not self._closed, "the next press has begun"
        if previous < len(self.poses) and self.poses[previous].tip_mm == tip_mm:
            if previous == len(self._knots):
                self._solve_planned(previous)
            return self._knots[previous]
        start, pose = self._state(previous, tip_mm), KnotPose(tip_mm, seconds, 1.0)
        state, knot = self._solve(start, pose, self._last_key + 1, True)
        self._last_key += 1
        self._remember(previous, self._last_key, state)
        return knot

    def solve_all(self, progress: KnotProgress | None = None) -> tuple[SolvedKnot, ...]:
        for k in range(len(self._knots), len(self.poses)):
            start_s = time.perf_counter()
            self.next(k, self.poses[k].tip_mm, 0.0)
            if progress:
                progress(k + 1, len(self.poses), time.perf_counter() - start_s)
        return self.knots

    def close(self) -> None:
        """Free fields and solver (a quarter of a gigabyte and more); keep counts and flags."""
        self._knots = [replace(k, **UNKEPT_FIELDS) for k in self._knots]
        self._states, self.states, self._contact, self._closed = {}, [], None, True

    # -- solving ---------------------------------------------------------------------------------

    def _solve_planned(self, previous: int) -> None:
        if self.stored is not None and self.stored["ended"] is not None:
            kind, reason = self.stored["ended"]
            raise END_ERRORS[kind](reason)
        pose = self.poses[previous]
        last = previous + 1 == len(self.poses)
        try:
            start = self._state(previous, pose.tip_mm)
            state, knot = self._solve(start, pose, previous + 1, last)
        except tuple(END_ERRORS.values()) as error:
            kind = next(name for name, cls in END_ERRORS.items() if type(error) is cls)
            self._keep((kind, str(error)))
            raise
        self._knots.append(knot)
        self._remember(previous, previous + 1, state)
        if self._keeps_states:
            self.states += [start, state] if previous == 0 else [state]
        if last:
            self._keep(None)

    def _solve(
        self, start: State, pose: KnotPose, key: int, last: bool
    ) -> tuple[State, SolvedKnot]:
        start_s = time.perf_counter()
        x, y, z = self.mirror.point(pose.tip_mm)
        if self._coarser is not None and self._guide is None and self._coarser.states:
            self._guide = self.contact.guide(self._coarser.states)
        state = self.contact.solve(start, (x, y, -z), pose.seconds, self._guide)
        flags = list(state.diagnostics.flags)
        field = traction = zone_map = None
        fields = self.observed.fields
        if fields == "all" or (fields == "last" and last):
            field, below = clamp_to_floor(state.displacement_mm.astype(np.float32), self._floor_mm)
            flags += below
            zone_map = state.zones[1]
            if self.observed.traction:
                traction = state.traction_mpa.astype(np.float32)
        self.solves += 1
        self.seconds += time.perf_counter() - start_s
        d = state.diagnostics
        knot = SolvedKnot(
            key, state.force_n, state.torque_nmm, state.zones[0], field, tuple(flags), traction,
            d.penetration_mm, d.most_stretch, d.cuts,
            self.contact.lacking_rel(state) if last and self.observed.lacking else 0.0, zone_map,
        )  # fmt: skip
        return state, self.mirror.knot_image(knot)

    # -- states ----------------------------------------------------------------------------------

    def _state(self, key: int, tip_mm: Point) -> State:
        """Return the solver's state at a knot; solve stored knots again for it."""
        if key == 0:
            return self.contact.rest(self.mirror.point((tip_mm[0], tip_mm[1], 0.0)))
        if key in self._states:
            return self._states[key]
        assert key <= len(self.poses), "a hold can go back by one knot, never by two"
        state = self.contact.rest(self.mirror.point((*self.poses[0].tip_mm[:2], 0.0)))
        for number, pose in enumerate(self.poses[:key], start=1):
            state, _ = self._solve(state, pose, number, False)
        self._states[key] = state
        return state

    def _remember(self, previous: int, key: int, state: State) -> None:
        # Two are enough: a hold can go back by one knot, never by two.
        self._states = {k: s for k, s in self._states.items() if k == previous} | {key: state}

    # -- the store -------------------------------------------------------------------------------

    def _load(self) -> dict[str, Any] | None:
        """Load the store's entry, its knots mirrored to this press; None: no complete one.

        ended: (kind of error, message) where the gel could not be solved at the next knot.
        """
        entry = None if self._key is None else SOLVED_PATHS.read(self._key)
        if entry is None or (len(entry["knots"]) != len(self.poses) and entry["ended"] is None):
            return None
        self._knots = [self.mirror.knot_image(knot) for knot in entry.pop("knots")]
        return dict(entry)

    def _keep(self, ended: tuple[str, str] | None) -> None:
        if self._key is None:
            return
        x_mm, y_mm = self.axes_mm
        entry = {"x_mm": x_mm, "y_mm": y_mm, "seconds": self.seconds, "dofs": self.contact.dofs}
        entry |= {"ended": ended, "knots": [self.mirror.knot_image(k) for k in self._knots]}
        SOLVED_PATHS.write(self._key, entry)


def clamp_to_floor(
    displacement_mm: NDArray[np.float32], floor_mm: float
) -> tuple[NDArray[np.float32], list[Note]]:
    """Clamp a face's displacement (ny, nx, 3) to the gel's floor, with a flag if it was below.

    The solver has no contact of the gel with itself or its floor: where a deep drag folds the face
    between large cells, a part of it can end up inside the window.
    """
    below = -floor_mm - displacement_mm[..., 2]
    if not (below > 0).any():
        return displacement_mm, []
    clamped = displacement_mm.copy()
    clamped[..., 2] = np.maximum(clamped[..., 2], np.float32(-floor_mm))
    text = (
        f"{int((below > 0).sum())} of {below.size} points of the face lie below the gel's "
        f"floor, by {below.max():.2g} mm at most, and are clamped to it"
    )
    return clamped, [Note("floor", text)]
