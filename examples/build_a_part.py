"""Build a part of a changed design, compare its volume with a formula, and export it.

python examples/build_a_part.py OUT
"""

from __future__ import annotations

import sys
from pathlib import Path

import deltact_fab as dt


def main(out: Path) -> tuple[float, float]:
    """Volume of a skin 14 mm thick (mm3): of the solid, and from its closed form."""
    skin = dt.build_part("skin", changes=["skin.thickness_mm=14"])
    dt.export_parts(skin.design, [skin.part], ("step", "stl"), 0.05, out, cached=False)
    return skin.volume_mm3, skin.design.skin_volume_mm3


if __name__ == "__main__":
    solid_mm3, formula_mm3 = main(Path(sys.argv[1]))
    print(f"skin: {solid_mm3:.1f} mm3, from its formula {formula_mm3:.1f} mm3")
