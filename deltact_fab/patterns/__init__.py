"""Patterns: a recipe becomes patches, dots, a printer's file and a virtual sticker's colours."""

from .dots import check_inside
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
