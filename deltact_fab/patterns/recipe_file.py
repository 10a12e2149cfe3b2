"""A recipe as a TOML file, the way back from `load_recipe`."""

from __future__ import annotations

import json
from collections.abc import Sequence

from .recipe import PatternRecipe


def toml(recipe: PatternRecipe, about: Sequence[str] = ()) -> str:
    """A recipe as the text of a TOML file; about: lines of comment above it.

    Every key that has a value is written, so that a later default cannot change the pattern.
    """
    data = recipe.model_dump(mode="json", exclude_none=True)
    lines = [f"# {line}" for line in about]
    lines += [f"{k} = {json.dumps(v)}" for k, v in data.items() if not isinstance(v, dict)]
    for key, table in data.items():
        if isinstance(table, dict):
            lines += ["", f"[{key}]", *(f"{k} = {json.dumps(v)}" for k, v in table.items())]
    return "\n".join(lines) + "\n"
