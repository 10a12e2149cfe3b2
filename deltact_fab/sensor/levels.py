"""The levels of the gel's mechanics by name, the cheapest first. Imports no solver."""

from __future__ import annotations

from deltact_fab.common import did_you_mean

GEL_LEVELS = ("linear", "hyperelastic")
FORMER_LEVELS = {"layer": "linear", "block": "linear"}
"""Linear levels of older files; there is one now."""


def find_level(name: str) -> str:
    """The level of a name, of a former one too. Raises ValueError for any other."""
    level = FORMER_LEVELS.get(name, name)
    if level not in GEL_LEVELS:
        raise ValueError(f"no such level; {did_you_mean(name, GEL_LEVELS)}")
    return level
