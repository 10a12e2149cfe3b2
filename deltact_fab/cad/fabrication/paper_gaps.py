"""Where the paper's numbers contradict each other or say nothing, and what was chosen.

The sentences stand in paper_gaps.toml; here are the figures in them that no design has by name.
"""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..dimensions import Design
from ..parts.screw import stock_note
from ..sensor_sections import LightDimensions
from ..standards import CAP_SCREWS
from ..stiffness import press
from . import quantities

PATTERN_MM = 35.0
PLATE_MM = 2.0
PRESS_MM = SHEAR_MM = 10.0
STRIP_MM = 10.0


def gaps(design: Design) -> list[dict[str, str]]:
    """Every contradiction and gap, the figures of this design worked in.

    said: the paper. found: why that does not do. chosen: what this design does instead.
    """
    return filled_in(__file__, d=design, f=_figures(design))["gap"]


def filled_in(module: str, **values: Any) -> dict[str, list[dict[str, str]]]:
    """The tables of the TOML file beside a module, values worked into their texts."""
    text = Path(module).with_suffix(".toml").read_text(encoding="utf-8")
    return {
        name: [{key: said.format(**values) for key, said in row.items()} for row in rows]
        for name, rows in tomllib.loads(text).items()
    }


def _figures(d: Design) -> dict[str, Any]:
    under_mm = d.cover.floor_mm - d.screw.row.head_height_mm
    room_mm = d.z_joint_mm - d.z_board_front_mm
    lens = [key for key in d.unverified() if key.startswith("camera.")]
    side_mm = min(d.skin.width_mm, d.skin.length_mm)
    found = press(d, d.plate.force_n)
    # The paper's plate, its x edges free.
    shell, optics = replace(d.shell, ledge_x_mm=0.0), replace(d.optics, acrylic_mm=PLATE_MM)
    thin = press(replace(d, shell=shell, optics=optics), d.plate.force_n)
    return {
        "longest_mm": CAP_SCREWS["M1.6"].stock_mm[-1],
        "stocked": stock_note(d) or f"{d.screw.thread} x {d.screw.length_mm:g} is stocked",
        "under_head": f"{under_mm:.2g} mm" if under_mm > 0 else "nothing",
        "bears_mm": d.z_head_mm - d.z_back_mm,
        "beside_mm": (d.frame.wall_y_mm - d.screw.row.clearance_mm) / 2,
        "notched": _notched(d),
        "plate_mm": [2 * half_mm for half_mm in d.acrylic_half_mm],
        "thin_mm": thin.deflection_mm,
        "edges": "four" if d.shell.ledge_x_mm > 0 else "two",
        "press": found,
        "of_depth": 100 * found.deflection_mm / d.plate.depth_mm,
        "strain": 100 * d.snap_strain,
        "strain_limit": 100 * d.cover.strain_limit,
        "paper_ma": LightDimensions(resistor_ohm=750.0, supply_v=5.0).total_ma,
        "sold_ohm": quantities.resistor_for_ohm(20.0, d.light)[1],
        "room_mm": room_mm,
        "strip_room": f"{room_mm - STRIP_MM:.2g} mm" if room_mm > STRIP_MM else "nothing",
        "camera": f"unverified ({len(lens)} keys): measure yours" if lens else "measured",
        "side_mm": side_mm,
        "within": "wider than" if side_mm < PATTERN_MM else "within",
        "deep": 100 * PRESS_MM / d.skin.thickness_mm,
        "sheared_mm": d.skin.length_mm / 2 - SHEAR_MM,
    }


def _notched(d: Design) -> str:
    """What makes room for the posts."""
    parts = {"skin": d.post_in_window_mm, "acrylic": d.acrylic_notch_mm}
    names = [name for name, notch in parts.items() if any(notch)]
    if not names:
        return "the walls of the frame hold them"
    return f"{' and '.join(names)} {'are' if len(names) > 1 else 'is'} notched around them"
