"""The testing shell: the shell with two table tabs in place of the mount, one on each x side.

Seen along -y:

        +-------------------+
        |       shell       |
    +---+                   +---+     the tabs' undersides lie in the plane of the sensor's back:
    |tab|                   |tab|     they are screwed to the table with the cover on it
    +---+-------------------+---+
"""

from __future__ import annotations

from collections.abc import Iterator

from ..dimensions import Design
from ..drafting.dimensioning import SQUARE_EDGES, Callouts, Cut, shown, x_of
from ..kernel import Shape, Workplane, cuboid, cylinders
from ..part import BLACK, PRINT, RESIN, Part, PrintPose
from ..rule import PlayFit, Quantity, Rule
from ..solid_gate import Box, around
from . import shell
from .mount import boss_room


def box(design: Design) -> Box:
    """Shell and tabs."""
    x, y = (side / 2 for side in design.frame_outer_mm)
    return around(x + design.table.tab_mm, y, design.z_back_mm, design.z_joint_mm)


def build(design: Design) -> Shape:
    """The shell with two table tabs in place of the mount, one solid in the sensor frame."""
    return shell.body(design).union(_tab(design, -1)).union(_tab(design, 1)).val()


def _tab(design: Design, side: int) -> Workplane:
    """One tab at +x (side 1) or -x (-1); it touches the wall and clears floor and bosses."""
    table, fit = design.table, design.cover.fit_mm
    face = design.frame_outer_mm[0] / 2
    half, back = table.width_mm / 2, design.z_back_mm

    def bar(near: float, far: float, y: float, low: float, high: float) -> Workplane:
        x = sorted((side * near, side * far))
        return cuboid(((x[0], -y, low), (x[1], y, high)))

    tab = bar(face, face + table.tab_mm, half, back, back + table.height_mm)
    tab = tab.cut(bar(face - 1, face + fit, half + 1, back - 1, design.z_floor_mm))
    tab = tab.cut(boss_room(design))
    middle = side * (face + table.tab_mm / 2)
    at = [(middle, sy * table.hole_pitch_mm / 2) for sy in (-1, 1)]
    return tab.cut(cylinders(at, table.hole_mm, back - 1, table.height_mm + 2))


def rules(d: Design) -> Iterator[Rule]:
    """Tabs around their holes, and higher than the cover."""
    table = d.table
    around = table.hole_mm + 2 * table.edge_mm
    yield Quantity("table: hole + 2 edge_mm", around).at_most("tab_mm", table.tab_mm)
    yield Quantity("table: pitch + hole + 2 edge_mm", table.hole_pitch_mm + around).at_most(
        "width_mm", table.width_mm
    )
    yield Quantity("table: width_mm", table.width_mm).at_most("outer y", d.frame_outer_mm[1])
    yield Quantity("cover + 2", d.cover.floor_mm + 2.0).at_most("table.height_mm", table.height_mm)
    yield Quantity("table.height_mm", table.height_mm).at_most(
        "cover and shell", d.z_joint_mm - d.z_back_mm
    )


def fits(d: Design) -> Iterator[PlayFit]:
    """The cover between the tabs."""
    between = d.resin_printer.inner(d.frame_outer_mm[0] + 2 * d.cover.fit_mm)
    cover = d.resin_printer.outer(d.frame_outer_mm[0])
    parts = "testing-shell, cover"
    yield PlayFit("cover between the tabs", parts, (between,), (cover,))


def callouts(d: Design) -> Callouts:
    """The shell with its two table tabs."""
    notes = (
        f"Walls {shown(d.shell.wall_mm)} all around. Tabs clear the cover by "
        f"{shown(d.cover.fit_mm)}.",
        f"Undersides of both tabs level and flat: they stand on the table. {SQUARE_EDGES}",
    )
    ox = d.frame_outer_mm[0] / 2
    lengths = (*shell.body_lengths(d), x_of(-ox, ox, fitted=False))
    return Callouts(
        lengths, fitted=(d.screw.row.clearance_mm,), notes=notes,
        cut=Cut(0.0),
    )  # fmt: skip


PARTS = (
    Part(
        "testing-shell",
        f"{RESIN}, black",
        PRINT,
        build,
        box,
        group="bench",
        colour=BLACK,
        sections=("shell", "cover", "table", "screw", "skin", "frame"),
        derived=(
            "frame_outer_mm", "cavity_half_mm", "post_mm", "post_edge_mm", "boss_room_mm",
            "ledge_half_mm", "ledge_reach_mm", "screw_at_mm", "screw_centres_mm", "shell_depth_mm",
            "z_joint_mm", "z_boss_mm", "z_floor_mm", "z_back_mm",
        ),
        rules=rules,
        fits=fits,
        wall_keys=("shell.wall_mm",),
        callouts=callouts,
        note="in place of the shell; {d.table.screw} screws into the table",
        lies=PrintPose(face="back", tilt_deg=20, supports="outside only"),
        look_for="as the shell; tabs flat on the table",
    ),
)  # fmt: skip
