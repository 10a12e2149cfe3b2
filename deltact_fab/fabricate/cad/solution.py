"""The solution of a wish: its design, the verdict of `cad check` on it, and what it costs.

A failed check on solids that has a remedy is repaired like one by arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice

from deltact_fab.common import InputError, Progress
from deltact_fab.sensor import GelMaterial, LayeredPath, flat_punch_n_per_mm

from .check.verdict import DesignVerdict, judge_design
from .check.visibility import raw_mm_per_px, sharp_depth_mm
from .design import load_cameras
from .dimensions import Design
from .intent import GEL_RANGE_MM, Choices, Unsolved, Wish, apply_remedy, find_design, search_choices
from .parts.light_holder import plate_bending_room
from .stiffness import press_plate

MAX_SOLID_REPAIRS = 4  # by hand: each costs a check of all solids
MAX_NEAREST = 4  # by hand: wishes that are checked on solids before none is said to pass
CHANGES_25TH = (1, 2, 3, 4, 6, 8, 11, 14, 17)  # by hand: more take longer
PUNCH_MM = 5.0  # by hand, radius of the punch that compares two gels: a fingertip's


@dataclass(frozen=True)
class Figure:
    """A figure of the solution. base: of the design it started from."""

    name: str
    value: float
    base: float
    unit: str


@dataclass(frozen=True)
class Solution:
    """A design that meets a wish, with the verdict of its checks."""

    wish: Wish
    base: Design
    design: Design
    verdict: DesignVerdict

    @property
    def summary(self) -> str:
        """The wish and the verdict in one line."""
        x, y = self.wish.face_mm
        wish = f"face of {x:g} x {y:g} mm, {100 * self.wish.share:g} % of it visible"
        return f"Solved for a {wish}: {self.verdict.failure or self.verdict.text}."

    @property
    def notes(self) -> list[str]:
        """Return camera, screws and mount, and a gel that the wish does not name."""
        design, skin, old = self.design, self.design.skin, self.base.skin
        mount = design.mount.holes if design.mount.kind == "flange" else design.mount.kind
        screw = f"{design.screw.thread} x {design.screw.length_mm:g}"
        notes = [f"Camera {design.camera.name}; screws {screw}; mount {mount}."]
        if self.wish.gel_mm is None and skin.thickness_mm != old.thickness_mm:
            gels = f"{skin.thickness_mm:g} mm and not the base's {old.thickness_mm:g}"
            notes.append(f"Gel of {gels}, for even light.")
        return notes

    @property
    def figures(self) -> list[Figure]:
        """Return what was solved for, and what the gel costs."""
        rows = zip(_figures(self.design), _figures(self.base), strict=True)
        return [Figure(name, value, base[1], unit) for (name, value, unit), base in rows]


def _figures(design: Design) -> Iterator[tuple[str, float, str]]:
    skin, optics, plate = design.skin, design.optics, design.plate
    for axis, side in zip("xyz", design.outer_mm, strict=True):
        yield f"outer size, {axis}", side, "mm"
    share = math.prod(optics.view_mm) / (skin.width_mm * skin.length_mm)
    yield "share of the face in view", share, ""
    yield "raw pixel on the face", raw_mm_per_px(design), "mm"
    yield "gel", skin.thickness_mm, "mm"
    yield "depth of a press, largest", plate.depth_mm, "mm"
    yield "depth of field, into the gel", min(sharp_depth_mm(design), skin.thickness_mm), "mm"
    yield "force of a press, largest", _most_n(design), "N"
    material = GelMaterial()
    stiffness = flat_punch_n_per_mm(PUNCH_MM, skin.thickness_mm, material)
    yield f"gel under a flat punch of {2 * PUNCH_MM:g} mm", stiffness, "N/mm"
    yield "parallax at the view's corner, 1 mm deep", _parallax_px(design, 1.0), "raw px"


def _most_n(design: Design) -> float:
    """Largest force within plate.stress_limit_mpa, deflection_share and the room for the ring."""
    plate, unit = design.plate, press_plate(design, 1.0)
    room_mm = max(plate_bending_room(design).range_mm[0], 0.0)
    limits = (
        (plate.stress_limit_mpa, unit.stress_mpa),
        (plate.deflection_share * plate.depth_mm, unit.deflection_mm),
        (room_mm, unit.over_ring_mm),
    )
    return min(limit / per_n for limit, per_n in limits if per_n > 0)


def _parallax_px(design: Design, depth_mm: float) -> float:
    """Motion in the raw image of the face's point in the view's corner, pressed straight down."""
    optics, radius_mm = design.optics, math.hypot(*design.optics.view_mm) / 2
    depth_mm = min(depth_mm, design.skin.thickness_mm)
    path = LayeredPath(optics.air_gap_mm, optics.acrylic_mm, design.skin.thickness_mm)
    pressed = replace(path, gel_mm=path.gel_mm - depth_mm)
    start, end = (p.half_angle_rad(radius_mm) for p in (path, pressed))
    if design.camera.projection == "rectilinear":
        start, end = math.tan(start), math.tan(end)
    return design.focal_px * abs(end - start)


def solve_wish(
    wish: Wish, base: Design, name: str, progress: Progress | None = None,
    nearest: bool = False, advise: bool = True,
) -> Solution:  # fmt: skip
    """Return the solution of a wish; check its verdict, it may fail.

    nearest: that of the nearest wish that passes instead. Raises InputError with the failed check
    and, unless `advise` is False, the changes that pass by arithmetic: the smallest, and those that
    keep the face.
    """
    fault, too_near = "", False
    try:
        solution = _solve(wish, base, name, progress)
        if not (nearest and solution.verdict.failed):
            return solution
        fault = solution.verdict.failure or ""
    except Unsolved as error:
        fault = str(error)
        # Neither face nor share changes the nearest focus.
        too_near = error.check is not None and error.check.id == "focus.nearest"
    x, y = wish.face_mm
    fault = f"a face of {x:g} x {y:g} mm: {fault}"
    if not advise:
        raise InputError(fault)
    cameras = [(f"--camera {camera}", replace(wish, camera=camera)) for camera in load_cameras()]
    changes = cameras if too_near else [*_changes(wish), *cameras]
    solvable = (item for item in changes if _passes(item[1], base))
    if nearest:
        for _, changed in islice(solvable, MAX_NEAREST):
            solution = _solve(changed, base, name, progress)
            if not solution.verdict.failed:
                return solution
    smallest = next(solvable, None)
    if smallest is None:
        raise InputError(f"{fault}; no change of it passes, nor does a listed camera")
    advice = f"smallest change that passes: {smallest[0]} (--nearest writes it)"
    # The best of each kind that keeps the face.
    for option in ("--share", "--gel", "--camera"):
        kind = (item for item in changes if item[0].startswith(option) and item != smallest)
        typed = next((typed for typed, changed in kind if _passes(changed, base)), None)
        if typed is not None and not smallest[0].startswith(option):
            advice += f"; {typed} keeps the face"
    raise InputError(f"{fault}; {advice}")


def _solve(wish: Wish, base: Design, name: str, progress: Progress | None) -> Solution:
    """Solve a wish and check it on solids, repairing what has a remedy. Raises Unsolved."""
    design, choices = search_choices(wish, base, Choices())
    for _ in range(MAX_SOLID_REPAIRS):
        solution = Solution(wish, base, design, judge_design(design, name, progress))
        repairs = (apply_remedy(choices, r.id, design, wish) for r in solution.verdict.failed)
        repaired = next((changed for changed in repairs if changed is not None), None)
        if repaired is None:
            break
        try:
            design, choices = search_choices(wish, base, repaired)
        except Unsolved:
            break
    return solution


def _changes(wish: Wish) -> Iterator[tuple[str, Wish]]:
    """Yield wishes with another face, share or gel and the option to type, smallest change first.

    Scales both sides of the face, or the longer one alone: the light around the view is round.
    """
    for k in CHANGES_25TH:
        for scale in (1 - k / 25, 1 + k / 25):
            for scaled in (wish.face_mm, (max(wish.face_mm),)):
                x, y = (float(round(scale * s)) if s in scaled else s for s in wish.face_mm)
                yield f"--face {x:g}x{y:g}", replace(wish, face_mm=(x, y))
            if wish.gel_mm is not None and scale * wish.gel_mm >= GEL_RANGE_MM[0]:
                gel_mm = round(scale * wish.gel_mm, 1)
                yield f"--gel {gel_mm:g}", replace(wish, gel_mm=gel_mm)
        share = round((1 - k / 25) * wish.share, 2)
        yield f"--share {share:g}", replace(wish, share=share)


def _passes(wish: Wish, base: Design) -> bool:
    with suppress(Unsolved):
        find_design(wish, base)
        return True
    return False
