"""Which source texts a figure of the gel depends on, and their hash."""

from __future__ import annotations

import hashlib
from pathlib import Path

PACKAGE = Path(__file__).parents[2]
FINITE = ("gel/finite/*.py", "gel/material.py", "gel/footprint.py", "shapes/*.py")
"""The finite-strain level by itself; a test holds it to what it imports."""
LEVELS = ("gel/**/*.py", "shapes/*.py")
CASES = ("numerics/engines/gel_scene.py", "numerics/engines/gel_checks.py")
RUNS = ("numerics/engines/gel.py", "numerics/engines/gel_run.py")


def source_hash(*patterns: str) -> str:
    """Of the package's files that match, by name and content."""
    text = hashlib.sha256()
    for path in sorted({p for pattern in patterns for p in PACKAGE.glob(pattern)}):
        text.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes())
    return text.hexdigest()[:16]
