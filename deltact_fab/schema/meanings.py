"""What each key of a model means: its metadata, or the docstring below it in the source."""

from __future__ import annotations

import ast
import dataclasses
import functools
import sys
import typing
from pathlib import Path
from types import UnionType
from typing import Any


def models(kind: Any) -> dict[str, type]:
    """A model and all models inside it, by class name."""
    found: dict[str, type] = {}
    waiting = [kind]
    while waiting:
        one = waiting.pop()
        if isinstance(one, type) and _is_model(one):
            if found.setdefault(one.__name__, one) is not one:
                raise ValueError(f"two models of one file are called {one.__name__}")
            waiting += typing.get_type_hints(one, include_extras=False).values()
        elif typing.get_origin(one) is not None or isinstance(one, UnionType):
            waiting += [part for part in typing.get_args(one) if part not in found.values()]
    return found


def _is_model(kind: type) -> bool:
    return hasattr(kind, "model_fields") or dataclasses.is_dataclass(kind)


def meanings(model: type) -> dict[str, str]:
    """Meaning of each key that says one, on one line."""
    said: dict[str, str] = {}
    for one in reversed(model.__mro__):
        if one.__module__.partition(".")[0] not in ("builtins", "pydantic"):
            said |= _docstrings(one.__module__).get(one.__name__, {})
    for name, extra in metadata(model).items():
        if "meaning" in extra:
            said[name] = extra["meaning"][:1].upper() + extra["meaning"][1:]
    return {name: " ".join(text.split()) for name, text in said.items()}


def metadata(model: type) -> dict[str, Any]:
    """Metadata of a dataclass' fields; empty for any other model."""
    if not dataclasses.is_dataclass(model):
        return {}
    return {f.name: f.metadata for f in dataclasses.fields(model)}


@functools.cache
def _docstrings(module: str) -> dict[str, dict[str, str]]:
    """By class, the string below each annotated name: Python itself does not keep them."""
    file = sys.modules[module].__file__
    tree = ast.parse(Path(file).read_text(encoding="utf-8")) if file else ast.Module([], [])
    found: dict[str, dict[str, str]] = {}
    for node in ast.walk(tree):
        if not isinstance(node, ast.ClassDef):
            continue
        said = found.setdefault(node.name, {})
        for above, below in zip(node.body, node.body[1:], strict=False):
            if (
                isinstance(above, ast.AnnAssign)
                and isinstance(above.target, ast.Name)
                and isinstance(below, ast.Expr)
                and isinstance(below.value, ast.Constant)
                and isinstance(below.value.value, str)
            ):
                said[above.target.id] = below.value.value
    return found
