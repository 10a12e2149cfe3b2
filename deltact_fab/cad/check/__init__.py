"""`cad check`: what the built solids are, held against what the sensor needs; one table.

run.py is the way in; built.py makes solids and meshes, the other files hold one kind of check each.
"""

from __future__ import annotations

from .row import Row
from .run import run

__all__ = ["Row", "run"]
