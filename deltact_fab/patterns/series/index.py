"""What was written into a folder: the SHA-256 of every file, kept in one of them, a JSON file."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from .folder import sha256

KEY = "sha256"
"""Of the JSON file: {path: digest}. Its own is of its text without its own entry."""


def to_json(data: dict[str, Any]) -> bytes:
    """The text of a JSON file that this package writes."""
    return (json.dumps(data, indent=1, allow_nan=False) + "\n").encode()


def seal(folder: Path, name: str, data: dict[str, Any]) -> None:
    """Write `data` as the file `name` of a folder that is else complete, and the index into both.

    Raises OSError.
    """
    held = sorted(path for path in folder.rglob("*") if path.is_file() and path != folder / name)
    index = {path.relative_to(folder).as_posix(): sha256(path) for path in held}
    index[name] = hashlib.sha256(to_json({**data, KEY: index})).hexdigest()
    data[KEY] = index
    (folder / name).write_bytes(to_json(data))


def read(folder: Path, name: str, form: str) -> dict[str, str]:
    """The index of a folder, {path: SHA-256}; empty where `name` is no such file of format `form`.

    The digest of `name` itself is empty, as of no file, if it was changed. Raises OSError.
    """
    file = folder / name
    if file.is_symlink() or not file.is_file():
        return {}
    raw = file.read_bytes()
    try:
        data = json.loads(raw)
        if data["format"] != form:
            return {}
        index = {str(path): str(digest) for path, digest in data[KEY].items()}
        own = index.pop(name)
        whole = raw == to_json(data) and hashlib.sha256(to_json({**data, KEY: index}))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}
    unchanged = whole and whole.hexdigest() == own
    return {**index, name: hashlib.sha256(raw).hexdigest() if unchanged else ""}
