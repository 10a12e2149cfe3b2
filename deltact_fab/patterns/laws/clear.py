"""Clear film, with or without dots: a single white patch, that is, no ink."""

from __future__ import annotations

import numpy as np

from .law import Law, Patches, PatchRecipe


def _draw(recipe: PatchRecipe) -> Patches:
    return np.full((recipe.n, recipe.n, 1), 255, np.uint8)


LAWS = {
    "dot-matrix": Law("dots on clear film", _draw, needs=("dots",), may=()),
    "transparent": Law("clear film", _draw, needs=(), may=()),
}
