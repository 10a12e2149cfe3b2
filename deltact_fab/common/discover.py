"""What a folder of modules holds: a file that is put there is found, and no list names it."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Collection
from typing import Any


def collect_entries(
    package: str | None, table: str, besides: Collection[str] = ()
) -> dict[str, Any]:
    """Join the tables of one name that the modules of a package's folder have.

    A table is a dict, or a tuple of what has a `name`. besides: modules that are no entries.
    A file that calls this with `__package__` depends on all of them, and `digest` counts them so.
    Raises RuntimeError when two of them claim one key.
    """
    assert package, "a package's own name"
    entries: dict[str, Any] = {}
    folder = importlib.import_module(package).__path__
    for name in sorted(m.name for m in pkgutil.iter_modules(folder) if m.name not in besides):
        rows = getattr(importlib.import_module(f"{package}.{name}"), table, {})
        for key, value in rows.items() if isinstance(rows, dict) else ((e.name, e) for e in rows):
            if key in entries:
                origin = f"one in {package}.{name}"
                raise RuntimeError(f"two entries of {table} are called {key!r}, {origin}")
            entries[key] = value
    return entries
