"""Every part is one valid closed solid, and its triangles close, too."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...errors import RunFailed
from ..part import GROUPS
from .built import MESH_MM, Built
from .row import Row

NAME = "one valid closed solid"
LIMIT = "every part, and its mesh closed"


def rows(built: Built) -> Iterator[Row]:
    """A row for each group of parts, naming what is wrong with which."""
    for group in GROUPS:
        names = [part.name for part in built.parts if part.group == group]
        wrong = {name: text for name in names if (text := _flaw(built, name))}
        if wrong:
            found = f"{len(wrong)} of {len(names)} not: " + "; ".join(wrong.values())
        else:
            triangles = sum(len(built.mesh(name).triangles) for name in names)
            found = f"{len(names)} of {len(names)}, {triangles} triangles at {MESH_MM:g} mm"
        yield Row(NAME, group, found, LIMIT, not wrong)


def _flaw(built: Built, name: str) -> str:
    """What is wrong with a part, empty when nothing is."""
    if name in built.failed:
        return built.failed[name]
    flaw = of_shape(built.solid(name))
    if flaw:
        return f"{name}: {flaw}"
    try:
        built.mesh(name)
    except RunFailed as why:
        return str(why)
    return ""


def of_shape(shape: Any) -> str:
    """What keeps a shape from being one valid solid with one shell; empty when it is one."""
    solids = shape.Solids()
    if len(solids) != 1:
        return f"{len(solids)} solids, one is right"
    if not solids[0].isValid():
        return "the kernel calls it invalid"
    shells = solids[0].Shells()
    if len(shells) != 1:
        return f"{len(shells)} shells, one is right"
    if not shells[0].wrapped.Closed():
        return "its shell is open"
    return ""
