"""A design from its requirements: a face, the visible share of it, a gel, a camera, a mount.

All other dimensions follow, from equations or by repair: an inequality, fit or limit that fails
changes the dimension that is its remedy (`CHECK_REMEDIES`), until nothing fails or no remedy is
left. No solid is built: `solution` checks the result on solids.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

from deltact_fab.common import Check, InputError, SolverError
from deltact_fab.sensor import LayeredPath, ShapeError

from . import feasibility
from .check import arithmetic, visibility
from .design import load_camera
from .dimensions import Design
from .parts.camera import off_axis_mm
from .rule import statement
from .standards import (
    CABLE_SIDES,
    CAP_SCREWS,
    CHEESE_SCREWS,
    CHEESE_STOCK_MM,
    CableSide,
    CapThread,
    CheeseThread,
    parse_holes,
)
from .stiffness import bend, plate_of

GELS_MM = (14.0, 16.0, 18.0, 20.0)  # by hand, beyond the paper's 12: thicker costs silicone
GEL_RANGE_MM = 2.0, 60.0  # by hand: a thinner gel measures nothing, a thicker one is no skin
DEPTH_SHARE = 5 / 12  # by hand: the paper's design press of 5 mm into a gel of 12
FILLET_SHARE = 1 / 3  # by hand: the paper's edge of 2 mm on 6 mm of protrusion
SHEETS_MM = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # by hand: thicknesses of cast PMMA on sale
GAPS_MM = tuple(k / 2 for k in range(6, 91))
AXIAL_MM = tuple(k / 10 for k in range(10, 51))
STRIPS_MM = 8.0, 5.0  # by hand: widths of LED strip on sale
LEDGES_MM = tuple(k / 4 for k in range(9))  # by hand: a wider ledge leaves the posts
FEWER_CUTS = tuple(range(500, 0, -1))
THREAD_LIMITS_MM: tuple[tuple[CapThread, float], ...] = (
    ("M1.6", 45.0),
    ("M2", 50.0),
    ("M2.5", 55.0),
)  # by hand, largest longer side of the face per thread; longer sides take M3
DEFAULT_SHARE = 0.55  # by hand, visible share of the face: a larger one makes the sensor thicker
FACE_RANGE_MM = 10.0, 200.0  # by hand: wider accepts typing errors, narrower refuses sensors
MAX_REPAIRS = 400  # by hand: fewer give up on solvable designs, more take longer to refuse
RING_OF_VIEW = 1.2  # by hand, LEDs' circle beyond the view's corner: a larger one dims the middle
FLANGE_MM = 8.0  # by hand, least thickness of a flange: a thinner one bends
CORNER_RAD = math.radians(79.0)  # by hand, below visibility.GRAZING_RAD: a third is reflected there


@dataclass(frozen=True)
class Wish:
    """Requirements of a design: a face (x, y), and the minimum share of it in the camera's view.

    camera: a name from cad/cameras.toml. gel_mm: thickness of the gel. holes: pattern of a flange.
    cable_side: side of the cable's notch. None: the base's.
    """

    face_mm: tuple[float, float]
    share: float = DEFAULT_SHARE
    camera: str | None = None
    gel_mm: float | None = None
    holes: str | None = None
    cable_side: CableSide | None = None

    @classmethod
    def parse(
        cls, face: str, share: float | None = None, camera: str | None = None,
        gel_mm: float | None = None, holes: str | None = None, cable_side: str | None = None,
    ) -> Wish:  # fmt: skip
        """Parse requirements as typed; share None: DEFAULT_SHARE. Raises InputError."""
        share = DEFAULT_SHARE if share is None else share
        try:
            width, length = (float(word) for word in face.lower().split("x"))
        except ValueError:
            text = "expected two sides in mm, as in 60x50 (no round faces)"
            raise InputError(f"--face {face!r}: {text}") from None
        low, high = FACE_RANGE_MM
        if not (low <= width <= high and low <= length <= high):
            raise InputError(f"--face {face!r}: expected sides of {low:g} to {high:g} mm")
        if not 0.05 <= share <= 0.95:
            raise InputError(f"--share {share:g}: expected 0.05 to 0.95 of the face")
        if camera is not None:
            load_camera(camera)
        low, high = GEL_RANGE_MM
        if gel_mm is not None and not low <= gel_mm <= high:
            raise InputError(f"--gel {gel_mm:g}: expected {low:g} to {high:g} mm")
        if holes is not None:
            parse_holes(holes, "--mount")
        if cable_side is not None and cable_side not in CABLE_SIDES:
            raise InputError(f"--cable {cable_side!r}: expected one of {', '.join(CABLE_SIDES)}")
        return cls((width, length), share, camera, gel_mm, holes, cast(Any, cable_side))


@dataclass(frozen=True)
class Choices:
    """Dimensions that are not computed but changed by remedies.

    gel_mm: 0 for that of the wish or the base.
    """

    gel_mm: float = 0.0
    sheet_mm: float = SHEETS_MM[0]
    gap_mm: float = GAPS_MM[0]
    axial_mm: float = AXIAL_MM[0]
    cuts: int = 2
    strip_mm: float = STRIPS_MM[0]
    columns: int = 2
    rows: int = 2
    share: float = 1.0
    housing_mm: tuple[float, float] = (0.0, 0.0)
    ledge_mm: float = LEDGES_MM[0]


class Unsolved(Exception):
    """No remedy is left for a failed check. check: the first one; None for a bound."""

    def __init__(self, reason: str, check: Check | None = None) -> None:
        super().__init__(reason)
        self.check = check


def find_design(wish: Wish, base: Design) -> Design:
    """Return the design of a wish that passes every inequality, fit and limit by arithmetic.

    Raises Unsolved.
    """
    return search_choices(wish, base, Choices())[0]


def search_choices(wish: Wish, base: Design, choices: Choices) -> tuple[Design, Choices]:
    """Return the first design of a wish from these choices on, as `find_design`, and its choices.

    Raises Unsolved.
    """
    visited: set[Choices] = set()
    for _ in range(MAX_REPAIRS):
        visited.add(choices)
        try:
            design = build_design(wish, choices, base)
        except ShapeError as error:
            raise Unsolved(str(error)) from error
        if (flat := _flat_share(design)) < wish.share:
            text = f"view of the face: {100 * flat:.0f} % of it is flat; {100 * wish.share:g} %"
            raise Unsolved(f"{text} required")
        first = None
        # Later checks cost more: they run only if no earlier failure has a remedy.
        for check in failed_checks(design, wish):
            first = first or check
            remedied = apply_remedy(choices, check.id, design, wish)
            if remedied is not None and remedied not in visited:
                choices = remedied
                break
        else:
            if first is None:
                return design, choices
            raise Unsolved(failure_text(first), first)
    raise Unsolved(f"no solution after {MAX_REPAIRS} repairs")


def _flat_share(design: Design) -> float:
    """Share of the face within its rounded edges, less the lens's offset: no view is larger."""
    margin_mm = design.skin.edge_fillet_mm + off_axis_mm(design)
    sides = design.skin.width_mm, design.skin.length_mm
    return math.prod(max(side - 2 * margin_mm, 0.0) / side for side in sides)


def failed_checks(design: Design, wish: Wish) -> Iterator[Check]:
    """Yield the checks by arithmetic that fail."""
    view_x, view_y = design.optics.view_mm
    share = view_x * view_y / math.prod(wish.face_mm)
    if share < wish.share:
        text, limit = f"{100 * share:.0f} % of it", f"{100 * wish.share:g} % required"
        yield Check("view-share", "view of the face", "", text, limit, "fail")
    yield from (rule for rule in feasibility.rules(design) if rule.failed)
    optics = design.optics
    path = LayeredPath(optics.air_gap_mm, optics.acrylic_mm, design.skin.thickness_mm)
    angle = min(path.half_angle_rad(math.hypot(view_x, view_y) / 2), CORNER_RAD)
    cone_mm = replace(path, gel_mm=0.0).reach_mm(angle) + math.sqrt(2) * off_axis_mm(design)
    bore_mm = design.light_bore_mm
    if not cone_mm <= bore_mm:
        text, limit = f"radius {cone_mm:.1f} mm at the plate", f"bore radius {bore_mm:.1f} mm"
        yield Check("light-cone", "light cone", "", text, limit, "fail")
    for checks in (arithmetic.fits, arithmetic.light, visibility.view, arithmetic.platform):
        yield from (check for check in checks(design) if check.failed)
    try:
        yield from (check for check in arithmetic.bending(design) if check.failed)
    except SolverError as error:
        yield Check("plate-deflection", "plate deflection", "acrylic", str(error), "", "fail")


def failure_text(check: Check) -> str:
    """Format a failed check in one line."""
    if check.sign:
        return f"{check.subject}: {statement(check)}"
    return f"{check.name}: {check.value}" + (f"; {check.limit}" if check.limit else "")


def _with_wish(wish: Wish, base: Design) -> Design:
    """Return the base with the camera, mount and cable of a wish."""
    if wish.camera is not None:
        base = replace(base, camera=load_camera(wish.camera))
    if wish.holes is not None:
        mount = replace(base.mount, kind="flange", holes=wish.holes)
        # As thick as the shortest screw on sale lets it be.
        grip_mm = mount.thread.washer_height_mm + mount.thread.thread_mm
        mount = replace(mount, height_mm=FLANGE_MM)
        height_mm = round(mount.flange_screw_mm - grip_mm, 2)
        width_mm, length_mm = (math.ceil(2 * mm) / 2 for mm in mount.pattern_size_mm)
        mount = replace(mount, height_mm=height_mm, width_mm=width_mm, length_mm=length_mm)
        base = replace(base, mount=mount)
    if wish.cable_side is not None:
        base = replace(base, shell=replace(base.shell, cable_side=wish.cable_side))
    return base


def _skin(wish: Wish, choices: Choices, base: Design) -> tuple[Any, float]:
    """Return the skin of a wish, and the depth of its design press; the base's if its gel is."""
    width, length = wish.face_mm
    skin, depth_mm = replace(base.skin, width_mm=width, length_mm=length), base.plate.depth_mm
    gel_mm = choices.gel_mm or wish.gel_mm or skin.thickness_mm
    if gel_mm == skin.thickness_mm:
        return skin, depth_mm
    # The frame's front, beside the gel, is a wall.
    protrusion_mm = min(gel_mm / 2, round(gel_mm - base.shell.wall_mm, 3))
    fillet_mm = min(skin.edge_fillet_mm, round(FILLET_SHARE * protrusion_mm, 2))
    skin = replace(skin, thickness_mm=gel_mm, protrusion_mm=protrusion_mm, edge_fillet_mm=fillet_mm)
    return skin, min(depth_mm, round(DEPTH_SHARE * gel_mm, 2))


def build_design(wish: Wish, choices: Choices, base: Design) -> Design:
    """Build the design of a wish and choices. Raises ShapeError at the bounds of a dimension."""
    base, longer = _with_wish(wish, base), max(wish.face_mm)
    thread: CapThread = next((name for name, side in THREAD_LIMITS_MM if longer <= side), "M3")
    skin, depth_mm = _skin(wish, choices, base)
    # A thin frame takes no more than the least engagement.
    room_mm = skin.thickness_mm - skin.protrusion_mm + choices.sheet_mm
    room_mm -= base.shell.wall_mm + base.screw.tip_clearance_mm
    least_grip_mm = 2 * CAP_SCREWS[thread].thread_mm
    grip_mm = round(max(least_grip_mm, min(4.6, room_mm)), 2)
    design = replace(
        base, skin=skin, screw=replace(base.screw, thread=thread, engagement_mm=grip_mm)
    )
    # The housing encloses the skin, and the board between the posts.
    least_mm = 1.5 if thread == "M1.6" else 2.0
    walls = [
        round(max(low, (room - side) / 2), 3)
        for low, room, side in zip((least_mm, 3.0), choices.housing_mm, wish.face_mm, strict=True)
    ]
    drop = round(max(0.5, 0.1 * choices.sheet_mm + 0.4), 2)
    design = _fit_to_camera(design)
    design = replace(
        design,
        frame=replace(
            design.frame,
            wall_x_mm=walls[0], seat_x_mm=round(max(walls[0] - 1.5, 0.0), 3),
            wall_y_mm=walls[1], seat_y_mm=round(walls[1] - 1.5, 3),
        ),
        optics=replace(
            design.optics,
            acrylic_mm=choices.sheet_mm,
            air_gap_mm=choices.gap_mm,
            least_view_share=wish.share,
        ),
        shell=replace(
            design.shell, ledge_drop_mm=drop, ledge_height_mm=drop + 1.5,
            ledge_mm=design.shell.ledge_mm + choices.ledge_mm,
            ledge_x_mm=design.shell.ledge_x_mm + choices.ledge_mm * (design.shell.ledge_x_mm > 0),
        ),
        light=replace(
            design.light,
            led_count=choices.cuts * design.light.leds_per_cut,
            strip_width_mm=choices.strip_mm, axial_fit_mm=choices.axial_mm,
        ),
        # A press spreads no wider than the face.
        plate=replace(
            design.plate, spread_mm=min(design.plate.spread_mm, *wish.face_mm), depth_mm=depth_mm
        ),
        mold=replace(design.mold, columns=choices.columns, rows=choices.rows),
    )  # fmt: skip
    design = replace(design, optics=_largest_view(design, choices.share))
    design = replace(design, screw=replace(design.screw, length_mm=_screw_mm(design)))
    sides = [math.ceil(10 * side - 1e-6) / 10 for side in design.outer_mm]
    return replace(design, envelope=type(design.envelope)(*sides))


def _fit_to_camera(design: Design) -> Design:
    """Size the parts around the camera: screws, pegs, floors, cable notch."""
    camera, holder, shell, cover = design.camera, design.holder, design.shell, design.cover
    # Screws pass the holes with the printer's play; a board without holes is bonded.
    through = camera.hole_mm - 0.2
    thread: CheeseThread = next(
        (name for name, row in reversed(CHEESE_SCREWS.items()) if row.thread_mm <= through), "none"
    )
    row = CHEESE_SCREWS[thread]
    length_mm = next(mm for mm in CHEESE_STOCK_MM if mm >= camera.board_mm + row.thread_mm - 1e-6)
    notch_mm = max(shell.cable_height_mm, round(camera.cable_height_mm + 1.7, 2))
    room_mm = max(
        holder.clearance_mm, camera.connector_height_mm + 0.35, notch_mm,
        length_mm - camera.board_mm + 0.5,
    )  # fmt: skip
    design = replace(
        design,
        holder=replace(
            holder, screw=thread, clearance_mm=math.ceil(10 * room_mm - 1e-6) / 10,
            screw_length_mm=length_mm,
        ),
        light=replace(
            design.light,
            floor_mm=max(design.light.floor_mm, row.head_height_mm + design.light.head_room_mm),
        ),
        shell=replace(
            shell,
            cable_width_mm=camera.cable_width_mm + 1.0,
            cable_height_mm=notch_mm,
            cable_foam_mm=max(shell.cable_foam_mm, 2 * notch_mm + 1),
        ),
    )  # fmt: skip
    # The holder's arms close its window above.
    margin_mm = cover.hole_mm / 2 + holder.wall_mm
    peg_mm = math.ceil(2 * (design.holder_window_top_mm - margin_mm + 0.5)) / 2
    return replace(design, cover=replace(cover, peg_y_mm=max(cover.peg_y_mm, peg_mm)))


def _screw_mm(design: Design) -> float:
    """The longest stock screw whose head stays inside the sensor."""
    screw = design.screw
    room_mm = design.z_joint_mm + screw.engagement_mm - screw.row.head_height_mm - design.z_back_mm
    return float(max((mm for mm in screw.row.stock_mm if mm <= room_mm), default=3.0))


def _largest_view(design: Design, share: float) -> Any:
    """Return optics with the largest view within the flat of the face and the crop.

    share: fraction of that view used along each side.
    """
    optics, camera, skin = design.optics, design.camera, design.skin
    path = LayeredPath(optics.air_gap_mm, optics.acrylic_mm, skin.thickness_mm)
    offset = off_axis_mm(design)
    crop = camera.crop_half_mm
    half = [
        min(
            side / 2 - skin.edge_fillet_mm - offset,
            path.reach_mm(min(camera.angle_rad(c), CORNER_RAD)),
        )
        for side, c in zip((skin.width_mm, skin.length_mm), crop, strict=True)
    ]

    def in_crop(part: float) -> bool:
        x, y = (part * side for side in half)
        corner = math.hypot(x, y)
        angle = path.half_angle_rad(corner)
        have = camera.angle_rad(corner * min(crop[0] / x, crop[1] / y))
        return angle <= min(have, CORNER_RAD)

    part = next((p / 200 for p in range(200, 20, -1) if in_crop(p / 200)), 0.1) * share
    x, y = (2 * part * side for side in half)
    # The paper's resolution, unless the face is so large that pixels would add nothing, or the
    # camera's pixels are coarser.
    raw_mm = math.ceil(1e4 * visibility.raw_mm_per_px(design)) / 1e4
    mm_per_px = max(optics.mm_per_px, math.ceil(10 * x) / 1e4, raw_mm)
    size = [int(side / mm_per_px + 1e-9) for side in (x, y)]
    return replace(optics, mm_per_px=mm_per_px, image_width_px=size[0], image_height_px=size[1])


def apply_remedy(choices: Choices, id: str, design: Design, wish: Wish) -> Choices | None:
    """Apply the first possible remedy of a failed check; None if none is left."""
    return _first_possible(CHECK_REMEDIES.get(id, ()), choices, design, wish)


Remedy = Callable[[Choices, Design, Wish], "Choices | None"]


def _first_possible(remedies: Sequence[Remedy], *state: Any) -> Choices | None:
    changed = (remedy(*state) for remedy in remedies)
    return next((choices for choices in changed if choices is not None), None)


def _next_value(name: str, values: Sequence[float]) -> Remedy:
    """Return a remedy that takes the next of the values."""

    def next_choices(choices: Choices, design: Design, wish: Wish) -> Choices | None:
        remaining = values[values.index(getattr(choices, name)) + 1 :]
        changed: dict[str, Any] = {name: remaining[0]} if remaining else {}
        return replace(choices, **changed) if remaining else None

    return next_choices


def _thicker_gel(choices: Choices, design: Design, wish: Wish) -> Choices | None:
    """Take the next thickness of gel, unless the wish names one."""
    thicker = (mm for mm in GELS_MM if mm > design.skin.thickness_mm)
    gel_mm = next(thicker, None) if wish.gel_mm is None else None
    return None if gel_mm is None else replace(choices, gel_mm=gel_mm)


def _more_leds(choices: Choices, design: Design, wish: Wish) -> Choices | None:
    most_cuts = int(2 * math.pi * design.strip_radius_mm / design.light.cut_mm)
    return replace(choices, cuts=choices.cuts + 1) if choices.cuts < most_cuts else None


def _less_view(choices: Choices, design: Design, wish: Wish) -> Choices | None:
    """Reduce the view a little if it is larger than required."""
    share = math.prod(design.optics.view_mm) / math.prod(wish.face_mm)
    if (1 - 0.03 / choices.share) ** 2 * share < wish.share:
        return None
    return replace(choices, share=round(choices.share - 0.02, 2))


def _lower_light(choices: Choices, design: Design, wish: Wish) -> Choices | None:
    """Move the light away from the face: its LEDs overlap more."""
    axial_mm = round(choices.axial_mm + 0.5, 1)
    return replace(choices, axial_mm=axial_mm) if axial_mm <= AXIAL_MM[-1] else None


def _ring_round_view(choices: Choices, design: Design, wish: Wish) -> Choices | None:
    """Widen a ring of LEDs that lies within the view: it takes more of them."""
    inside = design.strip_radius_mm < RING_OF_VIEW * math.hypot(*design.optics.view_mm) / 2
    return _wider_ring(choices, design, wish) if inside else None


def _stiffer_plate(choices: Choices, design: Design, wish: Wish) -> Choices | None:
    """Take wider ledges where the bead yields more than the plate, else a thicker sheet."""
    soft, bare = plate_of(design), replace(plate_of(design), bead_mm=0.0)
    yields = [bend(plate, design.plate.spread_mm).deflection_mm for plate in (soft, bare)]
    remedies = [_next_value("sheet_mm", SHEETS_MM), _next_value("ledge_mm", LEDGES_MM)]
    if yields[0] > 2 * yields[1]:
        remedies.reverse()
    return _first_possible(remedies, choices, design, wish)


def _smaller_mold(choices: Choices, design: Design, wish: Wish) -> Choices | None:
    if choices.columns * choices.rows == 1:
        return None
    fewer_columns = choices.columns >= choices.rows
    return replace(choices, columns=1) if fewer_columns else replace(choices, rows=1)


def _wider_ring(choices: Choices, design: Design, wish: Wish) -> Choices | None:
    """Widen the housing by 1 mm where it holds the ring, with the base's ledges."""
    x, y = design.ledge_half_mm
    return _housing(0 if x <= y else 1)(replace(choices, ledge_mm=0.0), design, wish)


def _housing(axis: int) -> Remedy:
    def wider(choices: Choices, design: Design, wish: Wish) -> Choices | None:
        sides = list(choices.housing_mm)
        sides[axis] = max(sides[axis], math.floor(design.frame_outer_mm[axis])) + 1.0
        return replace(choices, housing_mm=(sides[0], sides[1])) if sides[axis] < 150 else None

    return wider


CHECK_REMEDIES: dict[str, tuple[Remedy, ...]] = {
    id: moves
    for ids, moves in (
        ("view-share focus.nearest focus.corner focus.pressed", (_next_value("gap_mm", GAPS_MM),)),
        ("light-cone", (_less_view, _wider_ring)),
        ("plate-clear-of-light light-holder.below-acrylic", (_next_value("axial_mm", AXIAL_MM),)),
        ("plate-deflection", (_stiffer_plate,)),
        ("plate-stress skin-frame.pilot", (_next_value("sheet_mm", SHEETS_MM),)),
        ("even-light", (_more_leds, _less_view, _lower_light, _ring_round_view, _thicker_gel,
                        _next_value("sheet_mm", SHEETS_MM))),
        ("light-holder.led-count", (_next_value("cuts", FEWER_CUTS),)),
        ("light-holder.strip led-strip.led-on-strip",
         (_next_value("strip_mm", STRIPS_MM), _next_value("gap_mm", GAPS_MM))),
        ("fits-printer.mold", (_smaller_mold,)),
        ("light-holder.screw-outside light-holder.screw-bore light-holder.peg-outside "
         "light-holder.peg-bore wall-thickness.light-holder",
         (_next_value("ledge_mm", LEDGES_MM), _wider_ring)),
        ("light-holder.lens-in-bore light-holder.led-in-channel", (_wider_ring,)),
        ("camera.board-in-shell-x camera-holder.in-shell-x camera-holder.between-bosses-x "
         "camera.board-beside-posts skin-frame.posts-x skin-frame.posts-y shell.cable-room",
         (_housing(0),)),
        ("shell.cable-turn camera.board-in-shell-y camera-holder.in-shell-y "
         "camera-holder.between-bosses-y", (_housing(1),)),
    )
    for id in ids.split()
}  # fmt: skip
"""Remedies by check id; the first that is possible is applied."""
