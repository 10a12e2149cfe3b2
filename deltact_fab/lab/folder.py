"""A working folder: the shipped files as a lab's own, with schemas for editors and a first tour."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from .. import catalog
from ..errors import InputError
from ..files import disk_errors
from ..schema import KINDS, document

SHIPPED = ("cad", "patterns", "protocols")
SCHEMAS = "schemas"


def init(folder: Path) -> list[Path]:
    """Write the folder and return its files.

    Raises InputError for a folder that holds anything but hidden files, RunFailed when the disk
    refuses.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: a file; expected the name of a new or empty folder")
    if folder.is_dir() and any(not path.name.startswith(".") for path in folder.iterdir()):
        raise InputError(f"{folder}: not empty; expected the name of a new or empty folder")
    texts = _texts()
    for name, text in texts.items():
        with disk_errors(folder / name):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in texts]


def _texts() -> dict[str, str]:
    """The text of each file, by its path in the folder."""
    from importlib.resources import files

    texts = {"README.md": files(__package__).joinpath("tour.md").read_text(encoding="utf-8")}
    for kind in KINDS.values():
        text = json.dumps(document(kind), indent=1, ensure_ascii=False, allow_nan=False)
        texts[f"{SCHEMAS}/{kind.name}.json"] = text + "\n"
    for top in SHIPPED:
        shipped = catalog.shipped_dir(top)
        for file in sorted(shipped.rglob("*")):
            if file.suffix not in (".toml", ".py"):
                continue
            name = Path(top) / file.relative_to(shipped)
            text, folder = file.read_text(encoding="utf-8"), name.parent.as_posix()
            if file.suffix == ".toml" and folder in catalog.KINDS:  # a camera file has no schema
                text = schema_line(kind_of(folder, catalog.read(file)), name.parent) + text
            texts[name.as_posix()] = text
    return texts


def kind_of(folder: str, data: dict[str, Any]) -> str:
    """The name in `KINDS` of what stands in a folder of the catalogue."""
    if folder == "cad":
        return next((kind for key, kind in catalog.LISTS.items() if key in data), "design")
    if folder == "protocols/rigs":
        return f"{data['kind']}-rig"
    return next(kind.name for kind in KINDS.values() if kind.catalogue == folder)


def schema_line(kind_name: str, folder: Path) -> str:
    """The line by which an editor (taplo, Even Better TOML) finds the schema of a file."""
    schema = os.path.relpath(Path(SCHEMAS, f"{kind_name}.json"), folder)
    return f"#:schema {Path(schema).as_posix()}\n"
