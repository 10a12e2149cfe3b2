"""From a recipe to its patches: the one way, whatever the law.

The names of Algorithm 1 stand here too, for its numerics.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..recipe import PatternRecipe
from .algorithm1 import (
    FILE_LEVELS,
    Rejection,
    fill,
    fill_by_rejection,
    fill_row_major,
    hang_probability,
    least_difference,
    step_levels,
)
from .table import LAWS

__all__ = [
    "FILE_LEVELS",
    "Rejection",
    "draw_patches",
    "fill",
    "fill_by_rejection",
    "fill_row_major",
    "hang_probability",
    "least_difference",
    "step_levels",
]


def draw_patches(recipe: PatternRecipe) -> NDArray[np.uint8]:
    """The patches of a recipe, (n, n, 3) uint8 RGB; row 0, column 0 is the corner at (-x, -y).

    Clear film is one white patch: no ink, and the white layer behind it shows.
    """
    drawn = LAWS[recipe.law].draw(recipe)
    return np.ascontiguousarray(np.broadcast_to(drawn, (recipe.n, recipe.n, 3)))
