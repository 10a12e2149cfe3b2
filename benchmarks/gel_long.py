"""The lines of the gel's stability table that take a minute or more each, and the long drags."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

from deltact_fab.physics.gel.level import Reach
from deltact_fab.physics.gel.level_selection import select_level
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.studies.numerics.engine import Case
from deltact_fab.studies.numerics.engines import gel_press as checks
from deltact_fab.studies.numerics.engines.gel import cases_by_friction, cases_by_poisson
from deltact_fab.studies.numerics.engines.gel_press import GelCase, down

from . import gel_checks
from .gel_energy import work_but_jumps
from .gel_picks import one_increment_of_the_level

DEPTHS = (0.05, 0.5, 0.9)  # of the thickness
SHARP = ("hexprism", "star", "edges", "4dots")
DRAG_MM = 1.6  # cells of the long drags


def cases() -> list[Case]:
    """What `deltact-fab numerics` leaves out of its table."""
    percent, force = "% of the force", "of the force"
    deep, corner = GelCase(spacing_mm=1.5), GelCase("sphere:10", 1.5)
    out = [
        *cases_by_poisson((0.4, 0.45, 0.49, 0.495, 0.499)),
        *cases_by_friction((0.0, 0.1, 1.0, 5.0)),
        *_thickness(),
        *_sharp(),
    ]
    out += [
        # Friction is of first order in the increment: the interface of all levels parts a long one.
        Case("10 mm in one increment, friction 0.5: against 10", "right",
             partial(one_increment_of_the_level, 10.0, 2.0), 0.1, force),
        Case("10 mm deep: finer mesh", "right",
             partial(checks.mesh_error_percent, deep, 1.0, (down(10.0),)), 3.0, percent),
        Case("10 mm deep: work of the indenter", "right", partial(
             checks.evaluate_law, checks.work_error_percent, deep, 1.0, (down(10.0),)), 0.5,
             "% of the energy"),
        Case("four corners, sphere:10 at 14, 13 mm, 3 mm deep", "right",
             partial(gel_checks.corners, corner, (14.0, 13.0), 3.0), 1e-6, force),
        Case("four corners, sphere:10 on the very corner, 2 mm deep", "right or refused",
             partial(gel_checks.corners, corner, (18.0, 17.0), 2.0), 1e-6, force, "t"),
    ]  # fmt: skip
    small = GelCase("sphere:30", 1.0, side_mm=(12.0, 12.0), focus=None)
    out += [
        Case(f"{name} on a gel of 12 x 12 mm, 5 mm deep: finer mesh", "right",
             partial(checks.mesh_error_percent, replace(small, indenter=name), 1.0, (down(5.0),)),
             3.0, percent)
        for name in ("sphere:30", "hexprism:20")
    ]  # fmt: skip
    return out


def _thickness() -> list[Case]:
    out = []
    for thickness in (1.0, 12.0, 30.0):
        for share in DEPTHS:
            scene, step = _thick(thickness, share)
            press = (scene, step, share * thickness)
            name = f"thickness {thickness:g} mm, {share:.0%} deep"
            # How far a gel can be pressed is a finding: refusing the deepest is allowed.
            expected: Any = "right" if share <= 0.5 else "right or refused"
            out += [
                Case(f"{name}: finer mesh", expected,
                     partial(gel_checks.thickness, *press, "force"), 3.0, "% of the force", "t"),
                Case(f"{name}: force grows, base carries it", expected,
                     partial(gel_checks.thickness, *press, "laws"), 1e-6, "of the force", "t"),
            ]  # fmt: skip
    return out


def _thick(thickness_mm: float, share: float) -> tuple[GelCase, float]:
    """A sphere pressed to a share of a gel's thickness; mesh and step as `gel press` picks them.

    On a thin gel all is smaller: its sides are many thicknesses away even so.
    """
    scene = GelCase(thickness_mm=thickness_mm)
    if thickness_mm < 6:
        scene = replace(scene, indenter="sphere:6", side_mm=(14.0, 13.0))
    reach = Reach(deepest_mm=share * thickness_mm)
    choice = select_level(scene.skin(), GelMaterial(), parse_indenter(scene.indenter), reach,
                          level="hyperelastic", friction=0.0)  # fmt: skip
    picked = replace(scene, spacing_mm=choice.spacing_mm, focus=choice.focus)
    return picked, choice.step_mm


def _sharp() -> list[Case]:
    """Half of the block."""
    out = []
    for name in ("star", "4dots"):
        half = GelCase(name, 0.6, 0.5, focus=(-6.0, 8.0, -6.0, 6.0), mirrors=(False, True))
        even = replace(half, focus=(-6.0, 6.0, -6.0, 6.0))
        tips = (down(4.0), (2.0, 0.0, 4.0))
        head = f"{name}, friction 0.5, 4 mm deep, dragged 2 mm"
        out += [
            Case(f"{head}: cone", "right or refused",
                 partial(checks.evaluate_law, checks.cone_excess, half, 0.5, tips), 5e-3,
                 "of the bound", "t"),
            Case(f"{head}: base carries the force", "right or refused",
                 partial(checks.evaluate_law, checks.imbalance, half, 0.5, tips), 1e-6,
                 "of the force", "t"),
        ]  # fmt: skip
        if name != "star":
            out.append(Case(f"{name}, 4 mm deep: no side force", "right or refused",
                            partial(gel_checks.side_force_of_a_press, even, 4.0), 1e-6,
                            "of the force", "t"))  # fmt: skip
        quarter = replace(even, friction=0.0, mirrors=(name != "star", True))
        out.append(Case(f"{name}, no friction, 4 mm deep: work but for jumps", "right or refused",
                        partial(work_but_jumps, quarter, 4.0), 0.5, "% of the energy",
                        "t"))  # fmt: skip
    return out


def drag_cases() -> list[Case]:
    """Sharp indenters to 10 mm with +-10 mm of shear, on cells of the pattern selection's size."""
    out = []
    for name in SHARP:
        for axis, letter in ((0, "x"), (1, "y")):
            # A mirror where indenter and path have it: the star's only one is y = 0.
            mirrors = (axis == 1 and name != "star", axis == 0)
            wide, narrow = (-17.0, 17.0), (-6.0, 6.0)
            box = (*wide, *narrow) if axis == 0 else (*narrow, *wide)
            scene = GelCase(name, DRAG_MM, 0.5, focus=box, mirrors=mirrors)
            call = partial(gel_checks.long_drag, scene, axis)
            out.append(Case(f"{name} to 10 mm, sheared +-10 mm in {letter}", "right or refused",
                            call, 0.05, "of the force", "t"))  # fmt: skip
    return out
