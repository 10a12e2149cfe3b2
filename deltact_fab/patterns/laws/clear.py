"""Clear film, with dots or without: one white patch, which is no ink."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .law import Law, Patches

if TYPE_CHECKING:
    from ..recipe import PatternRecipe


def _draw(recipe: PatternRecipe) -> Patches:
    return np.full((recipe.n, recipe.n, 1), 255, np.uint8)


LAWS = {
    "dot-matrix": Law("dots on clear film", _draw, needs=("dots",), may=()),
    "transparent": Law("clear film", _draw, needs=(), may=()),
}
