"""The levels of the gel's mechanics by name: a file each linear one, with LEVELS.

`hyperelastic`, finite strain, is a solver of its own (`gel.finite`). Imports no solver.
"""

from __future__ import annotations

from ..discover import entries, modules_in
from .linear import LinearLevel

LINEAR: dict[str, LinearLevel] = dict(
    sorted(
        entries(modules_in(__package__, besides=("linear",)), "LEVELS").items(),
        key=lambda named: (named[1].rank is None, named[1].rank),
    )
)
"""The one that `auto` tries first, first."""
FINITE = "hyperelastic"
LEVELS = (*LINEAR, FINITE)
