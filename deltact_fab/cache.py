"""The one content-hash store: what was measured or computed once, found again by what it was from.

An entry lies in the user's cache folder under the SHA-256 of its key: one line of JSON with the key
and plain data, then the bytes of a file where there is one, all held against a SHA-256. Losing the
folder costs time and nothing else.
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
    found = get_file(kind, key)
    return None if found is None else found[1]


def put(kind: str, key: dict[str, Any], value: Any) -> bool:
    """Store plain data under a key, whole or not at all; False when the folder refuses."""
    return put_file(kind, key, b"", value)


def get_file(kind: str, key: dict[str, Any]) -> tuple[bytes, Any] | None:
    """A file's bytes and the note stored with them, or None.

    Both are held against the SHA-256 they were stored with; a damaged entry counts as none.
    """
    key, path = _place(kind, key)
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

    False when the folder refuses. Key and note come back as JSON has them: tuples are lists.
    """
    key, path = _place(kind, key)
    note = _plain(note)
    head = {"key": key, "note": note, "sha256": _seal(key, note, data)}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole(path, sync=False) as part:
            part.write_bytes(json.dumps(head).encode() + b"\n" + data)
    except OSError:
        return False
    return True


def file_bytes(kind: str, key: dict[str, Any]) -> int:
    """What `put_file` under a key takes of the disk; 0 where there is nothing."""
    try:
        return _place(kind, key)[1].stat().st_size
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
    return hashlib.sha256(_text([key, note]) + b"\n" + data).hexdigest()


def _place(kind: str, key: dict[str, Any]) -> tuple[dict[str, Any], Path]:
    """A key as JSON gives it back, and where its entry lies."""
    name = hashlib.sha256(_text(key)).hexdigest()
    return _plain(key), user_folder() / kind / f"{name}.bin"


def _text(data: Any) -> bytes:
    return json.dumps(data, sort_keys=True, separators=(",", ":")).encode()


def _plain(data: Any) -> Any:
    return json.loads(json.dumps(data))
