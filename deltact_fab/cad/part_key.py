"""The one key of a part: all that its solid is made from, and what was found on it by that.

A part declares what it reads of a design, `Part.sections` and `Part.derived`; that this is all is
held by a test which notes every value read. What was found before is found again by the key.
"""

from __future__ import annotations

import hashlib
import json
import pkgutil
from collections.abc import Callable
from typing import Any

from .. import cache
from . import parts as parts_package
from .dimensions import Design
from .kernel import LIBRARIES
from .part import Part

KIND, CODE = "cad-check", "cad.check.run"
LIMIT_BYTES = 64 * 2**20
MOST = 20_000  # facts; a design has some 500


def part_key(part: Part, design: Design) -> dict[str, Any]:
    """Plain data: the part, and the sections and derived lengths that it declares."""
    read = {} if part.indenter else {n: getattr(design, n) for n in (*part.sections, *part.derived)}
    return {"part": cache.plain(part), **cache.plain(read)}


class Facts:
    """Plain data about solids by what they were found on, in the user's cache."""

    def __init__(self) -> None:
        self._held: dict[str, Any] = cache.get(KIND, made_by(CODE)) or {}
        self.computed: list[str] = []

    def found(self, what: str, key: Any, compute: Callable[[], Any]) -> Any:
        """What compute() returned for this key before, else returns now. What raises is not kept.

        what: names the fact; key: plain data, everything that it depends on beside the code.
        """
        text = json.dumps([what, cache.plain(key)], sort_keys=True)
        name = hashlib.sha256(text.encode()).hexdigest()
        if name in self._held:
            # Last again: the longest unused go first.
            value = self._held.pop(name)
        else:
            value = json.loads(json.dumps(compute()))
            self.computed.append(what)
        self._held[name] = value
        return value

    def save(self) -> None:
        """Store what is new for the next time; a folder that refuses costs time and no more."""
        if self.computed:
            kept = dict(list(self._held.items())[-MOST:])
            cache.put(KIND, made_by(CODE), kept, LIMIT_BYTES)


def made_by(module: str, **given: Any) -> dict[str, Any]:
    """A key of the cache: all code of a module and of every part, the libraries, what is given."""
    files = (f"cad.parts.{part.name}" for part in pkgutil.iter_modules(parts_package.__path__))
    return cache.key(module, *files, libraries=LIBRARIES, **given)
