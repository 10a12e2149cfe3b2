"""Which source texts a figure of the gel depends on, and their hash."""

from __future__ import annotations

import hashlib
from pathlib import Path

PACKAGE = Path(__file__).parents[2]
SHAPES = tuple(
    f"shapes/{n}.py" for n in ("__init__", "bounded", "indenter", "sensor", "tips", "turned")
)
PRISM = "shapes/prism.py"
"""Of what presses a prism or a star, and of nothing else."""
FINITE = ("gel/finite/[!g]*.py", "gel/material.py", "gel/footprint.py", *SHAPES)
"""The finite-strain level by itself; a test holds it to what it imports."""
SOLVED = (
    *FINITE,
    PRISM,
    "gel/linear/*.py",
    "gel/choose.py",
    "gel/level.py",
)
"""All levels on a mesh or grid that is picked or named; a test holds it to what these import."""
LEVELS = ("gel/**/*.py", *SHAPES)
"""The same with its error estimated and the mesh refined, and all else that is done with a gel."""
CASES = ("numerics/engines/gel_scene.py", "numerics/engines/gel_checks.py")
ENERGY = "numerics/engines/gel_energy.py"
STRAIGHT = "numerics/engines/gel_straight.py"
RUNS = ("numerics/engines/gel.py", "numerics/engines/gel_run.py")


def source_hash(*patterns: str) -> str:
    """Of the package's files that match, by name and content."""
    text = hashlib.sha256()
    for path in sorted({p for pattern in patterns for p in PACKAGE.glob(pattern)}):
        text.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes())
    return text.hexdigest()[:16]
