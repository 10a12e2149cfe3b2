"""Results that were found before, for every design from which they would read the same values.

Nothing says beforehand what a check depends on: what it read was noted when it ran, and its result
holds again where every one of these values is found again. Whatever a check reads, it reads through
here, so that a check which declares nothing is right too.

A design is handed out as one that notes each value that is read from it; a derived length counts
as one value, whatever it follows from. Code that is the same and reads the same values cannot do
anything else: the first value that differs would have to be read before anything differs.
"""

from __future__ import annotations

import json
import pkgutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import is_dataclass
from functools import cache as once
from types import MethodType
from typing import Any, TypeVar, cast

from ... import cache
from .. import parts as parts_package
from ..dimensions import Design
from ..kernel import LIBRARIES
from ..part import Part

KIND = "cad-check"
LIMIT_BYTES = 64 * 2**20
# Designs that one result is kept for; the oldest go first.
DESIGNS = 16

_DESIGN, _PARTS, _INDENTER = "design.", "parts", "indenter."
_GONE = object()

Result = dict[str, Any]
T = TypeVar("T")
Note = Callable[[str, Any], None]


class Known:
    """Results by name, and the design through which they are found.

    design: reads from it are noted. kept: whether results are looked for and stored in the user's
    cache; without it everything is computed. computed: names of what was, in order.
    """

    def __init__(self, design: Design, parts: Sequence[Part], kept: bool = False) -> None:
        self._real = design
        self._all = tuple(parts)
        self._frames: list[dict[str, Any] | None] = []
        self._values: dict[str, Any] = {}
        self._stored = _load() if kept else {}
        self._kept = kept
        self._grown = False
        self.computed: list[str] = []
        self.design: Design = watched(design, "", lambda path, v: self._note(_DESIGN + path, v))

    @property
    def parts(self) -> tuple[Part, ...]:
        """Every part; whoever asks for it depends on the list as a whole."""
        self._note(_PARTS, self._value(_PARTS))
        return self._all

    def source(self, part: Part) -> Any:
        """What the part is made from, its reads noted."""
        if part.indenter is None:
            return self.design
        path = _INDENTER + part.name
        self._note(path, self._value(path))
        return part.indenter

    def result(self, name: str, compute: Callable[[], Any]) -> Any:
        """What compute() returns, plain data, or what it returned when it read the same.

        name: unique to what is computed. What raises, and what stood on a part that failed
        (`spoil`), is not kept.
        """
        for entry in self._stored.get(name, ()):
            if all(self._value(path) == value for path, value in entry["reads"].items()):
                self.repeat(entry["reads"])
                return entry["value"]
        self.computed.append(name)
        with self.noting() as frame:
            value = compute()
        reads = frame[0]
        if self._kept and reads is not None:
            entries = [{"reads": reads, "value": value}, *self._stored.get(name, ())]
            self._stored[name] = entries[:DESIGNS]
            self._grown = True
        return value

    @contextmanager
    def noting(self) -> Iterator[list[dict[str, Any] | None]]:
        """What is read inside, as the one item of a list; None when it was spoiled."""
        self._frames.append({})
        found: list[dict[str, Any] | None] = []
        try:
            yield found
        finally:
            reads = self._frames.pop()
            found.append(reads)
            if reads is None:
                self.spoil()
            else:
                self.repeat(reads)

    def repeat(self, reads: dict[str, Any]) -> None:
        """Count what was read for something made earlier, as whoever uses it depends on it too."""
        for path, value in reads.items():
            self._note(path, value)

    def spoil(self) -> None:
        """Keep nothing of what is being computed."""
        self._frames[:] = [None] * len(self._frames)

    def save(self) -> None:
        """Store what is new for the next time; a folder that refuses costs time and no more."""
        if self._grown:
            cache.put(KIND, _key(), _data(self._stored), LIMIT_BYTES)

    def _note(self, path: str, value: Any) -> None:
        if self._frames and (frame := self._frames[-1]) is not None:
            frame[path] = value

    def _value(self, path: str) -> Any:
        """The plain data that this design, or this list of parts, has there."""
        if path not in self._values:
            self._values[path] = self._found(path)
        return self._values[path]

    def _found(self, path: str) -> Any:
        if path.startswith(_DESIGN):
            try:
                value = value_at(self._real, path.removeprefix(_DESIGN))
            except AttributeError:
                return _GONE
        elif path == _PARTS:
            value = cache.plain(self._all)
        else:
            name = path.removeprefix(_INDENTER)
            made_from = [part.indenter for part in self._all if part.name == name]
            if not made_from:
                return _GONE
            value = cache.plain(made_from[0])
        # As it comes back from the file: tuples are lists there.
        return _data(value)


def _data(value: Any) -> Any:
    return json.loads(json.dumps(value, default=repr))


def _load() -> dict[str, list[Result]]:
    return cache.get(KIND, _key()) or {}


def _key() -> dict[str, Any]:
    """All code that any check runs, each part's file included, and the libraries."""
    files = (f"cad.parts.{module.name}" for module in pkgutil.iter_modules(parts_package.__path__))
    return cache.key("cad.check.run", *files, libraries=LIBRARIES)


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
    return cache.plain(record)


@once
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
    state["_note"](path, cache.plain(value))
    return value
