"""The one content-hash store: what was measured or computed once, found again by what it was from.

An entry is plain JSON in the user's cache folder, under the SHA-256 of its key; the key stands in
the file too. Losing the folder costs time and nothing else.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sys
from pathlib import Path
from typing import Any

FOLDER_VARIABLE = "DELTACT_FAB_CACHE"


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
    path = _path(kind, key)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(json.dumps({"key": key, "value": value}, indent=1), encoding="utf-8")
        part.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        return False
    return True


def _path(kind: str, key: dict[str, Any]) -> Path:
    text = json.dumps(key, sort_keys=True, separators=(",", ":"))
    return user_folder() / kind / f"{hashlib.sha256(text.encode()).hexdigest()}.json"
