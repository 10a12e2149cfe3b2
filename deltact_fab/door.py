"""Door of a package: its public names, each loaded from its file on first use.

An `__init__.py` lists them once, as imports for type checkers:

    if TYPE_CHECKING:
        from .gel.press import press_gel
    else:
        __getattr__, __dir__ = open_door(__name__)

Type checkers, import-linter, `digest` and this module read the same statements, so no second list
can differ.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import ast
    from collections.abc import Callable


def open_door(package: str) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` for a package that lists its names as above."""
    module = sys.modules[package]
    names: dict[str, tuple[str, str]] = {}

    def homes() -> dict[str, tuple[str, str]]:
        if names:
            return names
        import ast  # `import deltact_fab` alone needs none of it

        loader = module.__spec__.loader if module.__spec__ else None
        source = loader.get_source(package) if loader else None  # type: ignore[attr-defined]
        names.update(door_imports(ast.parse(source or ""), package))
        return names

    def load(name: str) -> object:
        if name not in homes():
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        from importlib import import_module

        home, original = homes()[name]
        value = getattr(import_module(home), original)
        setattr(module, name, value)
        return value

    return load, lambda: sorted({*vars(module), *homes()})


def door_imports(tree: ast.Module, package: str) -> dict[str, tuple[str, str]]:
    """Map the names imported in a package's `__init__` to (module, name there).

    Counts imports at the top and under TYPE_CHECKING.
    """
    import ast
    from importlib.util import resolve_name

    nodes = list(tree.body)
    for node in tree.body:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            nodes += node.body
    return {
        alias.asname or alias.name: (
            resolve_name("." * node.level + (node.module or ""), package),
            alias.name,
        )
        for node in nodes
        if isinstance(node, ast.ImportFrom) and node.module != "__future__"
        for alias in node.names
    }
