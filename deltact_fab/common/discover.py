"""What a folder of modules holds: a file that is put there is found, and no list names it."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Collection, Iterator
from types import ModuleType
from typing import Any


def modules_in(package: str | None, besides: Collection[str] = ()) -> Iterator[ModuleType]:
    """The modules of a package's folder by name, but for those that are no entries of it.

    A file that calls this with `__package__` depends on all of them, and `digest` counts them so.
    """
    assert package, "a package's own name"
    folder = importlib.import_module(package).__path__
    for name in sorted(m.name for m in pkgutil.iter_modules(folder) if m.name not in besides):
        yield importlib.import_module(f"{package}.{name}")


def entries(modules: Iterator[ModuleType], table: str) -> dict[str, Any]:
    """The tables of that name which modules have, joined.

    Raises RuntimeError when two of them claim one key.
    """
    found: dict[str, Any] = {}
    for module in modules:
        for key, value in getattr(module, table, {}).items():
            if key in found:
                raise RuntimeError(f"two of {table} are called {key!r}, one in {module.__name__}")
            found[key] = value
    return found
