"""Contrast after a 1200 dpi printer and the camera: the paper's law in three patch sizes.

python examples/pattern_quality.py
"""

from __future__ import annotations

import deltact_fab as dt

SIZES_MM = (0.075, 0.15, 0.3)


def main() -> dict[float, float]:
    """Fraction of the designed contrast in the camera's image, by patch size (mm)."""
    kept = {}
    for patch_mm in SIZES_MM:
        recipe = dt.PatternRecipe(law="algorithm1", seed=7, patch_mm=patch_mm, r=0.1)
        share = dt.measure_pattern(recipe, view_mm=(8.0, 8.0)).camera_contrast
        assert share is not None, "a printed pattern has contrast"
        kept[patch_mm] = share
    return kept


if __name__ == "__main__":
    for patch_mm, share in main().items():
        print(f"patches of {patch_mm:g} mm: {share:.0%} of the contrast reaches the camera")
