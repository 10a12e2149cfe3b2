"""Every part is one valid closed solid, and its triangles close, too."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from ...errors import RunFailed
from ..part import GROUPS
from ..solid_gate import flaw_of
from .built import MESH_MM, BuiltDesign
from .row import Row

NAME = "one valid closed solid"
LIMIT = "every part, and its mesh closed"


def rows(built: BuiltDesign) -> Iterator[Row]:
    """A row for each group of parts, naming what is wrong with which."""
    for group in GROUPS:
        names = [part.name for part in built.parts if part.group == group]
        wrong, triangles = [], 0
        for name in names:
            try:
                triangles += built.fact("triangles", (name,), partial(_triangles, built, name))
            except RunFailed as why:
                wrong.append(built.failed.get(name, str(why)))
        found = f"{len(names)} of {len(names)}, {triangles} triangles at {MESH_MM:g} mm"
        if wrong:
            found = f"{len(wrong)} of {len(names)} not: " + "; ".join(wrong)
        yield Row(NAME, group, found, LIMIT, not wrong)


def _triangles(built: BuiltDesign, name: str) -> int:
    """Of its mesh. Raises RunFailed saying what is wrong with the part."""
    if flaw := flaw_of(built.solid(name)):
        raise RunFailed(f"{name}: {flaw}")
    return len(built.mesh(name).triangles)
