"""Folders that the package reads its own files from, however its modules are arranged.

`assets` holds what ships with the code and no lab edits: page templates, texts, tables, the font.
"""

from __future__ import annotations

from pathlib import Path

PACKAGE_DIR = Path(__file__).parent
"""The installed package `deltact_fab`."""
_ASSETS_FOLDER = PACKAGE_DIR / "assets"


def asset(name: str) -> Path:
    """The file or folder of that name among the assets."""
    return _ASSETS_FOLDER / name


def shipped_folder(kind: str) -> Path:
    """The catalogue folder `cad`, `patterns` or `protocols`: in the wheel, else in the checkout."""
    inside = PACKAGE_DIR / "_shipped" / kind
    return inside if inside.is_dir() else PACKAGE_DIR.parent / kind
