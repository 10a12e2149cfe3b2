"""What defines a law of patches; each file of this folder defines one or more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Patches = NDArray[np.uint8]

LAW_KEYS = ("patch_mm", "r", "channels", "scales_mm", "weights", "dots")
"""The keys of a recipe that belong to some laws only."""


PatchRecipe = Any
"""A `recipe.PatternRecipe`; that file imports this one."""


@dataclass(frozen=True)
class Law:
    """draw: a recipe to (n, n, 1 or 3) uint8. needs, may: keys of KEYS it must and can have."""

    about: str
    draw: Callable[[PatchRecipe], Patches]
    needs: tuple[str, ...] = ("patch_mm",)
    may: tuple[str, ...] = ("dots",)

    @property
    def has_patches(self) -> bool:
        """Whether its sticker is made of patches; otherwise it is clear film."""
        return "patch_mm" in self.needs

    @property
    def foreign_keys(self) -> list[str]:
        """The keys of other laws, which it does not take."""
        return [key for key in LAW_KEYS if key not in self.needs + self.may]


def uniforms(recipe: PatchRecipe) -> NDArray[np.float64]:
    """One draw in [0, 1) a patch and channel by the recipe's seed, (n, n, channels)."""
    shape = (recipe.n, recipe.n, recipe.channels)
    return np.random.Generator(np.random.PCG64(recipe.seed)).random(shape)
