"""Folders of the package's own files.

`assets` holds files that ship with the code and are not edited by labs: page templates, texts,
tables, the font.
"""

from __future__ import annotations

from pathlib import Path

PACKAGE_DIR = Path(__file__).parent
"""The installed package `deltact_fab`."""
_ASSETS_FOLDER = PACKAGE_DIR / "assets"


def asset(name: str) -> Path:
    """Path of a file or folder in assets."""
    return _ASSETS_FOLDER / name


def shipped_folder(kind: str) -> Path:
    """Catalogue folder `cad`, `patterns` or `protocols`, of the wheel or the checkout."""
    inside = PACKAGE_DIR / "_shipped" / kind
    return inside if inside.is_dir() else PACKAGE_DIR.parent / kind
