"""The folder of an export: its manifest, what is ours to replace in it, and the change at once."""

from __future__ import annotations

import hashlib
import json
import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from ...errors import InputError, RunFailed
from ..part import Matrix
from .part_files import FORMATS

MANIFEST = "manifest.json"
# What a manifest may name: nothing that leads out of its folder.
_OURS = re.compile(rf"[a-z0-9-]+\.(?:{'|'.join(FORMATS)})")


@dataclass(frozen=True)
class PartFile:
    """One written file. volume and box are the exact solid's, also for a mesh.

    turned: rotation from the part's frame to the printer's, of a file as it is printed; its box is
    the mesh's, which stands on z = 0, its middle at x = y = 0.
    """

    part: str
    file: str
    material: str
    process: str
    quantity: int
    volume_mm3: float
    bounding_box_mm: tuple[tuple[float, ...], tuple[float, ...]]
    mesh_deviation_mm: float | None
    sha256: str
    turned: Matrix | None = None


def manifest(files: Sequence[PartFile]) -> str:
    """The manifest's text: one entry a file, no times and no paths."""
    return json.dumps({"files": [asdict(f) for f in files]}, indent=2) + "\n"


@contextmanager
def staged(out_dir: Path) -> Iterator[Path]:
    """A temporary folder inside out_dir. On failure nothing is left of what was created."""
    created = [path for path in (out_dir, *out_dir.parents) if not path.exists()]
    try:
        try:
            out_dir.mkdir(parents=True, exist_ok=True)
        except OSError as why:
            raise InputError(f"{out_dir}: cannot be a folder to write: {why.strerror}") from why
        try:
            with tempfile.TemporaryDirectory(prefix=".export-", dir=out_dir) as folder:
                yield Path(folder)
        except OSError as why:
            raise RunFailed(f"{out_dir}: cannot be written: {why.strerror or why}") from why
    except BaseException:
        for path in created:
            with suppress(OSError):
                path.rmdir()
        raise


def place(folder: Path, out_dir: Path, names: Sequence[str]) -> None:
    """Put the files where they belong; what an earlier export left besides them goes."""
    # Once more: making them took a while.
    old = earlier(out_dir, names)
    # Never beside files that it does not describe, also when what follows is cut short.
    (out_dir / MANIFEST).unlink(missing_ok=True)
    for name in old.difference(names):
        (out_dir / name).unlink()
    for name in (*names, MANIFEST):
        os.replace(folder / name, out_dir / name)


def earlier(out_dir: Path, names: Iterable[str]) -> set[str]:
    """Files of an earlier export that are there as its manifest says: ours to remove.

    Raises InputError when anything else has one of the names.
    """
    listed = _listed(out_dir / MANIFEST)
    same = {name for name, sha256 in listed.items() if _sha256(out_dir / name) == sha256}
    if strange := [n for n in names if n not in same and os.path.lexists(out_dir / n)]:
        path = out_dir / strange[0]
        if path.is_dir():
            what = "a folder"
        else:
            what = "changed since its export" if path.name in listed else "not of an export"
        more = f" ({len(strange) - 1} more)" if strange[1:] else ""
        raise InputError(f"{path}: {what}{more}; move it away, or export into another folder")
    return same


def _listed(path: Path) -> dict[str, str]:
    """SHA-256 by file name as a manifest lists them; none when there is no manifest."""
    if not os.path.lexists(path):
        return {}
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))["files"]
        listed = {entry["file"]: entry["sha256"] for entry in entries}
        if not all(_OURS.fullmatch(n) and isinstance(s, str) for n, s in listed.items()):
            raise ValueError
    except OSError as why:
        raise InputError(f"{path}: cannot be read: {why.strerror}") from why
    except (ValueError, KeyError, TypeError, RecursionError) as why:
        raise InputError(
            f"{path}: damaged, or not an export's; move it away, or export into another folder"
        ) from why
    return listed


def _sha256(path: Path) -> str | None:
    """None where there is no plain file: a link was put there by somebody."""
    if path.is_symlink() or not path.is_file():
        return None
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as why:
        raise InputError(f"{path}: cannot be read: {why.strerror}") from why
