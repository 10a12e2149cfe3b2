"""Gel thickness: force at each thickness, and whether the design can be built.

    python examples/sweep_a_design.py

A thin gel is stiffer, because of its rigid back. The inequalities of the surrounding parts limit
the thickness.
"""

from __future__ import annotations

from dataclasses import dataclass

import deltact_fab as dt

THICKNESSES_MM = (8.0, 10.0, 12.0, 14.0, 16.0)
DEPTH_MM = 0.8


@dataclass(frozen=True)
class Row:
    """normal_n: force of a ball of 10 mm pressed DEPTH_MM deep. refused: reason for a refusal."""

    thickness_mm: float
    normal_n: float
    refused: str


def main() -> list[Row]:
    """One row per thickness."""
    rows, ball = [], dt.parse_indenter("sphere:10")
    for thickness_mm in THICKNESSES_MM:
        design = dt.load_design("deltact", changes=[f"skin.thickness_mm={thickness_mm:g}"])
        refused = ""
        try:
            dt.check_design(design)
        except dt.InputError as why:
            refused = str(why).partition(" | ")[0]
        pressed = dt.press_gel(
            design.skin, dt.GelMaterial(), ball, (0.0, 0.0), DEPTH_MM, model="linear"
        )
        rows.append(Row(thickness_mm, -pressed.result["force_n"][2], refused))
    return rows


if __name__ == "__main__":
    for row in main():
        print(f"{row.thickness_mm:4g} mm: {row.normal_n:.2f} N  {row.refused}")
