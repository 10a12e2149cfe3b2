"""Cache of computed results, addressed by the hash of their inputs.

An entry is a file in the user's cache folder named by the SHA-256 of its key: the pickled value,
preceded by a SHA-256 of key and value. Losing the folder costs only time. Its content is trusted,
like numba's compiled code: nobody else may have write access.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import json
import os
import pickle
import platform
import time
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

from deltact_fab.version import PACKAGE_VERSION

from . import digest
from .files import whole_file

FOLDER_VARIABLE = "DELTACT_FAB_CACHE"
_ABANDONED_S = 3600.0  # by hand: older partial files belong to dead processes
_SEAL_BYTES = 32  # definition: length of a SHA-256


def cache_folder() -> Path:
    """Return $DELTACT_FAB_CACHE, else deltact-fab in the user's cache folder; may not exist."""
    if override := os.environ.get(FOLDER_VARIABLE):
        return Path(override)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "deltact-fab"


def cache_key(
    *code: str, package: Path = digest.PACKAGE_DIR, libraries: tuple[str, ...] = (), **inputs: Any
) -> dict[str, Any]:
    """Make the key of a result from its code, library versions and inputs.

    code, package: as in `code_digest`. libraries: distributions whose versions count, together with
    the machine type. inputs: plain data and dataclasses.
    """
    made_by = _versions(libraries) if libraries else {}
    return {
        "code": digest.code_digest(*code, package=package),
        "made_by": made_by,
        **plain_data(inputs),
    }


def plain_data(value: Any) -> Any:
    """Convert nested dataclasses to plain data, each with its class name."""
    if is_dataclass(value) and not isinstance(value, type):
        inside = {f.name: plain_data(getattr(value, f.name)) for f in fields(value)}
        return {"class": type(value).__name__, **inside}
    if isinstance(value, Mapping):
        return {str(key): plain_data(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [plain_data(item) for item in value]
    # Its code is in the digest of the sources.
    return value.__qualname__ if callable(value) else value


@functools.cache
def _versions(libraries: tuple[str, ...]) -> dict[str, str]:
    versions = {
        "deltact-fab": PACKAGE_VERSION,
        "machine": platform.machine(),
        "zlib": zlib.ZLIB_RUNTIME_VERSION,
    }
    for name in libraries:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "absent"
    return versions


@dataclass(frozen=True)
class Store:
    """Cached values of one kind, by the key they were computed from.

    limit_bytes: disk space of the kind; the least recently used entries are deleted.
    """

    kind: str
    limit_bytes: int | None = None

    @property
    def folder(self) -> Path:
        """Folder of the kind; may not exist."""
        return cache_folder() / self.kind

    def read(self, key: dict[str, Any]) -> Any | None:
        """Return the value of a key, or None if it is missing or damaged."""
        path = cache_folder() / self.file(key)
        try:
            entry = path.read_bytes()
        except OSError:
            return None
        seal, data = entry[:_SEAL_BYTES], entry[_SEAL_BYTES:]
        if seal != _seal(path, data):
            return None
        # Time of last use, for `trim`.
        with contextlib.suppress(OSError):
            os.utime(path)
        return pickle.loads(data)

    def write(self, key: dict[str, Any], value: Any) -> bool:
        """Store a value under a key atomically; False if it could not be stored."""
        path, data = cache_folder() / self.file(key), pickle.dumps(value)
        try:
            _write_entry(path, _seal(path, data) + data)
        except OSError:
            return False
        if self.limit_bytes is not None:
            self.trim(self.limit_bytes)
        return True

    def file(self, key: dict[str, Any]) -> Path:
        """Path of a key's file, relative to the user's cache folder."""
        text = json.dumps(key, sort_keys=True, separators=(",", ":"))
        return Path(self.kind, f"{hashlib.sha256(text.encode()).hexdigest()}.bin")

    def trim(self, limit_bytes: int, keep: Iterable[dict[str, Any]] = ()) -> int:
        """Delete the least recently used files until they take at most limit_bytes.

        keep: keys just used; their files always fit. Partial files of dead processes are deleted
        too. Returns the bytes freed; errors of the folder are ignored.
        """
        candidates, freed = [], 0
        recent = (cache_folder() / self.file(key) for key in keep)
        limit_bytes = max(limit_bytes, sum(file.stat().st_size for file in recent if file.exists()))
        with contextlib.suppress(OSError), os.scandir(self.folder) as entries:
            for entry in entries:
                state = entry.stat(follow_symlinks=False)
                if entry.name.endswith(".part") and time.time() - state.st_mtime > _ABANDONED_S:
                    candidates.append((0.0, entry.name, state.st_size, entry.path))
                elif entry.name.endswith(".bin"):
                    candidates.append((state.st_mtime, entry.name, state.st_size, entry.path))
        total = sum(size for _, _, size, _ in candidates)
        for last_use, _, size, path in sorted(candidates):
            if last_use > 0 and total - freed <= limit_bytes:
                break
            with contextlib.suppress(OSError):
                os.unlink(path)
                freed += size
        return freed


def copy_in(name: str, data: bytes) -> None:
    """Add a file of another machine's store; errors of the folder are ignored."""
    path = cache_folder() / name
    with contextlib.suppress(OSError):
        if not path.exists():
            _write_entry(path, data)


def copy_out(names: Iterable[str]) -> dict[str, bytes]:
    """Return the bytes of those of the store's files that exist."""
    contents = {}
    for name in names:
        with contextlib.suppress(OSError):
            contents[name] = (cache_folder() / name).read_bytes()
    return contents


def _write_entry(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path, sync=False) as part:
        part.write_bytes(data)


def _seal(path: Path, data: bytes) -> bytes:
    return hashlib.sha256(path.stem.encode() + data).digest()
