"""Names of the gel models, cheapest first. Imports no solver."""

from __future__ import annotations

from deltact_fab.common import did_you_mean

GEL_LEVELS = ("linear", "tabulated", "hyperelastic")
FORMER_LEVELS = {"layer": "linear", "block": "linear"}
"""Names of the linear model in older files."""


def find_level(name: str) -> str:
    """Return the gel model of a name, also of a former one. Raises ValueError for any other."""
    level = FORMER_LEVELS.get(name, name)
    if level not in GEL_LEVELS:
        raise ValueError(f"no such level; {did_you_mean(name, GEL_LEVELS)}")
    return level
