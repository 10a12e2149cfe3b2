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
        seen = {
            name: built.result(f"{NAME}: {name}", partial(_seen, built, name)) for name in names
        }
        wrong = {name: text for name, (text, _) in seen.items() if text}
        if wrong:
            found = f"{len(wrong)} of {len(names)} not: " + "; ".join(wrong.values())
        else:
            triangles = sum(count for _, count in seen.values())
            found = f"{len(names)} of {len(names)}, {triangles} triangles at {MESH_MM:g} mm"
        yield Row(NAME, group, found, LIMIT, not wrong)


def _seen(built: BuiltDesign, name: str) -> tuple[str, int]:
    """What is wrong with a part, empty when nothing is, and the triangles of its mesh."""
    if why := built.why_not(name):
        return why, 0
    if flaw := flaw_of(built.solid(name)):
        return f"{name}: {flaw}", 0
    try:
        return "", len(built.mesh(name).triangles)
    except RunFailed as why_open:
        return str(why_open), 0
