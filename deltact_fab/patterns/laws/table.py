"""The laws that colour the patches. One law is one entry: the keys it takes, and how it draws.

    law          keys                                patches
    algorithm1   patch_mm, r, [channels]             neighbours differ by sqrt(r) (the paper's)
    iid          patch_mm, [channels]                independent, uniform on 0..255
    binary       patch_mm, [channels]                independent, 0 or 255
    octave       patch_mm, scales_mm, [weights],     blocks of several sizes added, then spread
                 [channels]                          evenly over 0..255
    chessboard   patch_mm                            black and white in turn
    dot-matrix   dots                                clear film under dots
    transparent  -                                   clear film

A seed names a sticker that was printed: another draw needs another law's name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...errors import did_you_mean
from . import algorithm1, octave

if TYPE_CHECKING:
    from ..recipe import PatternRecipe

Patches = NDArray[np.uint8]

KEYS = ("patch_mm", "r", "channels", "scales_mm", "weights", "dots")
"""The keys of a recipe that belong to some laws only."""


@dataclass(frozen=True)
class Law:
    """draw: a recipe to (n, n, 1 or 3) uint8. needs, may: keys of KEYS it must and can have."""

    about: str
    draw: Callable[[PatternRecipe], Patches]
    needs: tuple[str, ...] = ("patch_mm",)
    may: tuple[str, ...] = ("dots",)

    @property
    def has_patches(self) -> bool:
        """Whether its sticker is made of patches; otherwise it is clear film."""
        return "patch_mm" in self.needs


def check_law(name: str) -> str:
    """The name. Raises ValueError with the nearest law, or all of them, when there is none."""
    if name not in LAWS:
        raise ValueError(f"no such law; {did_you_mean(name, LAWS)}")
    return name


def check_key(name: str, key: str, is_given: bool) -> None:
    """Raise ValueError when a law lacks a key it needs, or is given one it does not take."""
    law = LAWS[name]
    if key in law.needs and not is_given:
        what = "a [dots] table" if key == "dots" else "it"
        raise ValueError(f"law {name!r} needs {what}")
    if is_given and key not in law.needs + law.may:
        if key == "dots":
            raise ValueError(f"law {name!r} has no dots: remove them, or use law 'dot-matrix'")
        if not law.has_patches:
            raise ValueError(f"law {name!r} has no patches: remove it")
        takes = ", ".join(k for k in KEYS if k in law.needs + law.may)
        raise ValueError(f"law {name!r} does not use it: remove it (it takes {takes})")


def _uniforms(recipe: PatternRecipe) -> NDArray[np.float64]:
    shape = (recipe.n, recipe.n, recipe.channels)
    return np.random.Generator(np.random.PCG64(recipe.seed)).random(shape)


def _algorithm1(recipe: PatternRecipe) -> Patches:
    assert recipe.r is not None  # the recipe's own check
    return algorithm1.fill(_uniforms(recipe), recipe.r).astype(np.uint8)


def _iid(recipe: PatternRecipe) -> Patches:
    return (_uniforms(recipe) * 256).astype(np.uint8)


def _binary(recipe: PatternRecipe) -> Patches:
    return (_uniforms(recipe) >= 0.5).astype(np.uint8) * np.uint8(255)


def _octave(recipe: PatternRecipe) -> Patches:
    assert recipe.scales_mm is not None
    assert recipe.patch_mm is not None
    blocks = [round(scale_mm / recipe.patch_mm) for scale_mm in recipe.scales_mm]
    rng = np.random.Generator(np.random.PCG64(recipe.seed))
    weights = recipe.weights or (1.0,) * len(blocks)
    return octave.draw(rng, recipe.n, recipe.channels, blocks, weights)


def _chessboard(recipe: PatternRecipe) -> Patches:
    place = np.arange(recipe.n)
    return ((place[:, None] + place) % 2 * 255).astype(np.uint8)[..., None]


def _clear(recipe: PatternRecipe) -> Patches:
    return np.full((recipe.n, recipe.n, 1), 255, np.uint8)


LAWS: dict[str, Law] = {
    "algorithm1": Law(
        "Algorithm 1 of the paper: neighbours differ by at least sqrt(r) in every channel",
        _algorithm1,
        needs=("patch_mm", "r"),
        may=("channels", "dots"),
    ),
    "iid": Law("independent uniform patches, colour or grey", _iid, may=("channels", "dots")),
    "binary": Law("independent patches, each channel 0 or 255", _binary, may=("channels", "dots")),
    "octave": Law(
        "independent blocks of several sizes, added and spread over all levels",
        _octave,
        needs=("patch_mm", "scales_mm"),
        may=("weights", "channels", "dots"),
    ),
    "chessboard": Law("black and white squares, to calibrate the camera", _chessboard),
    "dot-matrix": Law("dots on clear film", _clear, needs=("dots",), may=()),
    "transparent": Law("clear film", _clear, needs=(), may=()),
}
