"""The one content-hash store: what was measured or computed once, found again by what it was from.

An entry lies in the user's cache folder under the SHA-256 of its key, and the key stands in it
too: plain data as JSON, a file's bytes behind one line of JSON. Losing the folder costs time and
nothing else.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

from .files import whole

FOLDER_VARIABLE = "DELTACT_FAB_CACHE"
_ABANDONED_S = 3600.0


def user_folder() -> Path:
    """$DELTACT_FAB_CACHE, else the platform's cache folder; it need not exist."""
    if named := os.environ.get(FOLDER_VARIABLE):
        return Path(named)
    if sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "deltact-fab"


def get(kind: str, key: dict[str, Any]) -> Any | None:
    """The value stored under a key, or None; a damaged entry counts as none."""
    try:
        entry = json.loads(_path(kind, key).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return entry["value"] if isinstance(entry, dict) and entry.get("key") == key else None


def put(kind: str, key: dict[str, Any], value: Any) -> bool:
    """Store plain data under a key, whole or not at all; False when the folder refuses."""
    return _write(_path(kind, key), json.dumps({"key": key, "value": value}, indent=1).encode())


def get_file(kind: str, key: dict[str, Any]) -> tuple[bytes, Any] | None:
    """A file's bytes and the note stored with them, or None.

    Both are held against the SHA-256 they were stored with; a damaged entry counts as none.
    """
    path = _path(kind, key, ".bin")
    try:
        head, newline, data = path.read_bytes().partition(b"\n")
        entry = json.loads(head)
    except (OSError, ValueError):
        return None
    if not (newline and isinstance(entry, dict) and entry.get("key") == key):
        return None
    if entry.get("sha256") != _seal(key, entry.get("note"), data):
        return None
    # Its last use, which `trim` goes by.
    with contextlib.suppress(OSError):
        os.utime(path)
    return data, entry["note"]


def put_file(kind: str, key: dict[str, Any], data: bytes, note: Any = None) -> bool:
    """Store a file's bytes and a note of plain data under a key, whole or not at all.

    False when the folder refuses.
    """
    head = {"key": key, "note": note, "sha256": _seal(key, note, data)}
    return _write(_path(kind, key, ".bin"), json.dumps(head).encode() + b"\n" + data)


def file_bytes(kind: str, key: dict[str, Any]) -> int:
    """What `put_file` under a key takes of the disk; 0 where there is nothing."""
    try:
        return _path(kind, key, ".bin").stat().st_size
    except OSError:
        return 0


def trim(kind: str, limit_bytes: int) -> int:
    """Delete files of a kind, the longest unused first, until they take at most limit_bytes.

    What a process that died left half written goes too. Returns the bytes freed; a folder that
    refuses is left as it is.
    """
    held, freed = [], 0
    with contextlib.suppress(OSError), os.scandir(user_folder() / kind) as entries:
        for entry in entries:
            state = entry.stat(follow_symlinks=False)
            if entry.name.endswith(".part") and time.time() - state.st_mtime > _ABANDONED_S:
                held.append((0.0, entry.name, state.st_size, entry.path))
            elif entry.name.endswith(".bin"):
                held.append((state.st_mtime, entry.name, state.st_size, entry.path))
    total = sum(size for _, _, size, _ in held)
    for used, _, size, path in sorted(held):
        if used > 0 and total - freed <= limit_bytes:
            break
        with contextlib.suppress(OSError):
            os.unlink(path)
            freed += size
    return freed


def _seal(key: Any, note: Any, data: bytes) -> str:
    text = json.dumps([key, note], sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode() + b"\n" + data).hexdigest()


def _write(path: Path, data: bytes) -> bool:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole(path, sync=False) as part:
            part.write_bytes(data)
    except OSError:
        return False
    return True


def _path(kind: str, key: dict[str, Any], suffix: str = ".json") -> Path:
    text = json.dumps(key, sort_keys=True, separators=(",", ":"))
    return user_folder() / kind / f"{hashlib.sha256(text.encode()).hexdigest()}{suffix}"
