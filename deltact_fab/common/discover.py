"""Discovery of entries in a folder of modules: new files need no registration."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Collection
from typing import Any


def collect_entries(
    package: str | None, table: str, besides: Collection[str] = ()
) -> dict[str, Any]:
    """Merge the tables named `table` of all modules in a package's folder.

    A table is a dict, or a tuple of objects with a `name`. besides: modules to skip.
    `digest` counts all of these modules for a file that calls this with `__package__`.
    Raises RuntimeError for duplicate keys.
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
