"""Rules of what the sensor is made and tested with."""

from __future__ import annotations

from collections.abc import Iterator

from ..dimensions import Design
from .rule import Rule


def tools(d: Design) -> Iterator[Rule]:
    """Mold, coupon mold and the table tabs of the testing shell."""
    mold, table, coupon = d.mold, d.table, d.coupon
    yield Rule("mold", ("fit_mm + 2", mold.fit_mm + 2.0), "<=", ("web_mm / 2", mold.web_mm / 2))
    yield Rule("mold", ("pry_mm", mold.pry_mm), "<", ("web_mm / 2", mold.web_mm / 2))
    yield Rule("mold", ("seat_mm", mold.seat_mm), "<", ("frame height", d.frame_height_mm))
    yield Rule("mold", ("pry_width_mm", mold.pry_width_mm), "<", ("outer x", d.frame_outer_mm[0]))
    yield Rule(
        "testing-shell",
        ("table: hole + 2 x 3", table.hole_mm + 6.0),
        "<=",
        ("tab_mm", table.tab_mm),
    )
    yield Rule(
        "testing-shell",
        ("table: pitch + hole + 2 x 3", table.hole_pitch_mm + table.hole_mm + 6.0),
        "<=",
        ("width_mm", table.width_mm),
    )
    yield Rule(
        "testing-shell",
        ("table: hole + 3", table.hole_mm + 3.0),
        "<=",
        ("hole_pitch_mm", table.hole_pitch_mm),
    )
    yield Rule(
        "testing-shell", ("table: width_mm", table.width_mm), "<=", ("outer y", d.frame_outer_mm[1])
    )
    yield Rule(
        "testing-shell",
        ("cover + 2", d.cover.floor_mm + 2.0),
        "<=",
        ("table.height_mm", table.height_mm),
    )
    yield Rule(
        "testing-shell",
        ("table.height_mm", table.height_mm),
        "<=",
        ("cover and shell", d.z_joint_mm - d.z_back_mm),
    )
    yield Rule("coupon-mold", ("2", 2.0), "<=", ("diameter_mm", coupon.diameter_mm))
    # Where a tab stands over a boss of the cover it is relieved from below, or cut through.
    over = d.z_back_mm + table.height_mm - d.z_boss_mm
    beside = d.frame_outer_mm[1] / 2 - d.boss_room_mm
    if over > 0 and table.width_mm / 2 > beside:
        wall = ("shell.wall_mm", d.shell.wall_mm)
        yield Rule("testing-shell", wall, "<=", ("tab over the cover's bosses", over))
    # Two notches face each other across a web; half a wall of 1.5 stays on either side.
    yield Rule(
        "mold",
        ("fit_mm + pry_mm + 0.75", mold.fit_mm + mold.pry_mm + 0.75),
        "<=",
        ("web_mm / 2", mold.web_mm / 2),
    )
