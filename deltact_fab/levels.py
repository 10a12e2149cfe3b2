"""The levels of the gel's mechanics by name, the cheapest first. Imports no solver."""

from __future__ import annotations

from .errors import did_you_mean

LINEAR, FINITE = "linear", "hyperelastic"
LEVELS = (LINEAR, FINITE)
FORMER = {"layer": LINEAR, "block": LINEAR}
"""Linear levels of older files; there is one now."""


def level_called(name: str) -> str:
    """The level of a name, of a former one too. Raises ValueError for any other."""
    level = FORMER.get(name, name)
    if level not in LEVELS:
        raise ValueError(f"no such level; {did_you_mean(name, LEVELS)}")
    return level
