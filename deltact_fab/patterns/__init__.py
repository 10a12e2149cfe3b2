"""Patterns: a recipe becomes patches, dots, a printer's file and a virtual sticker's colours."""

from .dots import centres_csv, check_inside
from .metadata import read_recipe
from .raster import PatternFiles, albedo, make, raster
from .recipe import (
    DotGrid,
    PatternRecipe,
    centres_mm,
    draw_patches,
    load_recipe,
    recipe_from,
    recipe_from_options,
)

__all__ = [
    "DotGrid",
    "PatternFiles",
    "PatternRecipe",
    "albedo",
    "centres_csv",
    "centres_mm",
    "check_inside",
    "draw_patches",
    "load_recipe",
    "make",
    "raster",
    "read_recipe",
    "recipe_from",
    "recipe_from_options",
]
