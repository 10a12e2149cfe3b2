"""Type of a pattern law; each file of this folder defines one or more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Patches = NDArray[np.uint8]

LAW_KEYS = ("patch_mm", "r", "channels", "scales_mm", "weights", "dots")
"""Keys of a recipe that only some laws use."""


PatchRecipe = Any
"""A `recipe.PatternRecipe`, untyped to avoid a circular import."""


@dataclass(frozen=True)
class Law:
    """A law. draw: recipe to (n, n, 1 or 3) uint8. needs, may: required and optional LAW_KEYS."""

    about: str
    draw: Callable[[PatchRecipe], Patches]
    needs: tuple[str, ...] = ("patch_mm",)
    may: tuple[str, ...] = ("dots",)

    @property
    def has_patches(self) -> bool:
        """True if the sticker is made of patches; else it is clear film."""
        return "patch_mm" in self.needs

    @property
    def foreign_keys(self) -> list[str]:
        """Keys of other laws that this one does not use."""
        return [key for key in LAW_KEYS if key not in self.needs + self.may]


def uniforms(recipe: PatchRecipe) -> NDArray[np.float64]:
    """One draw in [0, 1) per patch and channel from the recipe's seed, (n, n, channels)."""
    shape = (recipe.n, recipe.n, recipe.channels)
    return np.random.Generator(np.random.PCG64(recipe.seed)).random(shape)
