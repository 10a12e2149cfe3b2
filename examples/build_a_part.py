"""Build a part of a changed design, hold it against a formula, and export it.

python examples/build_a_part.py OUT
"""

from __future__ import annotations

import sys
from pathlib import Path

from deltact_fab.cad.build import build_part
from deltact_fab.cad.design import load_design
from deltact_fab.cad.export import export_parts
from deltact_fab.cad.registry import find


def main(out: Path) -> tuple[float, float]:
    """Volume of a skin 14 mm thick (mm3): of the solid, and by its closed form."""
    design = load_design("deltact", changes=["skin.thickness_mm=14"])
    part = find("skin")
    _, measured = build_part(part, design)
    export_parts(design, [part], ("step", "stl"), 0.05, out, cached=False)
    return measured.volume_mm3, design.skin_volume_mm3


if __name__ == "__main__":
    solid_mm3, formula_mm3 = main(Path(sys.argv[1]))
    print(f"skin: {solid_mm3:.1f} mm3, by its formula {formula_mm3:.1f} mm3")
