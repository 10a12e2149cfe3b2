"""Several patterns on the same moving gel: frames drawn, tracked, and compared with the truth."""

from __future__ import annotations

from typing import Any

from ...patterns.recipe import recipe_from
from ..pattern_press import follow


def confirm(given: dict[str, Any]) -> dict[str, Any]:
    """As `pattern_press.follow`, of any recipe: from plain data that one reads none with scales."""
    recipes = {name: recipe_from(data, name) for name, data in given["patterns"].items()}
    return follow({**given, "patterns": recipes})
