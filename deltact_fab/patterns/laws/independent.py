"""Independent patches: uniform over all levels, or each channel 0 or 255."""

from __future__ import annotations

import numpy as np

from .law import Law, Patches, PatchRecipe, uniforms


def _iid(recipe: PatchRecipe) -> Patches:
    return (uniforms(recipe) * 256).astype(np.uint8)


def _binary(recipe: PatchRecipe) -> Patches:
    return (uniforms(recipe) >= 0.5).astype(np.uint8) * np.uint8(255)


LAWS = {
    "iid": Law("independent uniform patches, colour or grey", _iid, may=("channels", "dots")),
    "binary": Law("independent patches, each channel 0 or 255", _binary, may=("channels", "dots")),
}
