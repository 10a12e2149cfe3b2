"""The file of `--plot`: its place is checked before anything is solved, and written at the end."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..extras import require

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KINDS = ("png", "svg", "pdf")
DPI = 150


def require_place(path: Path) -> None:
    """Raises MissingLibrary without matplotlib, InputError for a file that could not be written."""
    require("report", "--plot", "matplotlib")
    if _kind(path) not in KINDS:
        raise InputError(f"--plot {path}: {', '.join('.' + k for k in KINDS)} is needed")
    if path.is_dir():
        raise InputError(f"--plot {path}: a folder; a file's name is needed")
    if not path.absolute().parent.is_dir():
        raise InputError(f"--plot {path}: there is no folder {path.parent}")


def save(figure: Figure, path: Path) -> None:
    """Write whole or not at all, without the date, where `require_place` has been.

    Raises InputError where the place refuses all the same.
    """
    kind = _kind(path)
    dates: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    drawn = io.BytesIO()
    figure.savefig(drawn, format=kind, dpi=DPI, metadata=dates.get(kind))
    try:
        path.write_bytes(drawn.getvalue())
    except OSError as why:
        raise InputError(f"--plot {path}: {why.strerror or why}") from why


def _kind(path: Path) -> str:
    return path.suffix.lower().lstrip(".")
