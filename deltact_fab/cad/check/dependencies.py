"""What a computation read of a design: its result holds for every design with the same values.

A design is handed out as one that notes each value that is read from it; a derived length counts
as one value, whatever it follows from. Code that is the same and reads the same values cannot do
anything else: the first value that differs would have to be read before anything differs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import is_dataclass
from functools import cache
from types import MethodType
from typing import Any, TypeVar, cast

from ..provenance import plain

T = TypeVar("T")
Note = Callable[[str, Any], None]


def watched(record: T, path: str, note: Note) -> T:
    """The record as one of a subclass that calls note(path, value) for each value read from it.

    Records inside are watched in turn; of everything else `value` is the plain data. A method
    runs on the watched record.
    """
    made: Any = object.__new__(_class(cast(Any, type(record))))
    for name, value in (("_real", record), ("_path", path), ("_note", note)):
        object.__setattr__(made, name, value)
    return cast(T, made)


def value_at(record: Any, path: str) -> Any:
    """The plain data at a path of `watched`. Raises AttributeError where there is none."""
    for name in path.split("."):
        record = getattr(record, name)
    return plain(record)


@cache
def _class(real: type) -> type:
    return type(real.__name__, (real,), {"__getattribute__": _read})


def _read(self: Any, name: str) -> Any:
    state = object.__getattribute__(self, "__dict__")
    real = state["_real"]
    if name == "__class__":
        return type(real)
    if name.startswith("__") and name != "__dict__":
        return object.__getattribute__(self, name)
    value = getattr(real, name)
    path = f"{state['_path']}.{name}" if state["_path"] else name
    if isinstance(value, MethodType) and value.__self__ is real:
        return MethodType(value.__func__, self)
    if is_dataclass(value) and not isinstance(value, type):
        return watched(value, path, state["_note"])
    state["_note"](path, plain(value))
    return value
