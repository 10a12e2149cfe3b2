"""Stratified grey: every block of 4 x 4 patches has one patch in each sixteenth of the grey levels.

Independent patches leave pale and dark areas by chance, where an optical flow finds little to
follow; here every area has contrast.
"""

from __future__ import annotations

import numpy as np

from .law import Law, Patches, PatchRecipe

SIDE = 4  # patches of a block


def _draw(recipe: PatchRecipe) -> Patches:
    rng = np.random.Generator(np.random.PCG64(recipe.seed))
    blocks = -(-recipe.n // SIDE)
    strata = np.tile(np.arange(SIDE**2), (blocks, blocks, 1))
    drawn = rng.permuted(strata, axis=2) + rng.random(strata.shape)
    grey = drawn.reshape(blocks, blocks, SIDE, SIDE).swapaxes(1, 2)
    grey = grey.reshape(blocks * SIDE, blocks * SIDE)[: recipe.n, : recipe.n]
    return (grey / SIDE**2 * 256).astype(np.uint8)[..., None]


LAWS = {"stratified": Law("every 4 x 4 patches hold all grey levels", _draw)}
