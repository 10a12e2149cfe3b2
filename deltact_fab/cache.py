"""The one content-hash store: what was measured or computed once, found again by what it was from.

An entry lies in the user's cache folder under the SHA-256 of its key: one line of JSON with the key
and the value, then the bytes of the arrays and files in it, all held against a SHA-256. Losing the
folder costs time and nothing else.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import json
import os
import platform
import time
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from . import digest
from .files import whole
from .version import VERSION

FOLDER_VARIABLE = "DELTACT_FAB_CACHE"
_ABANDONED_S = 3600.0
_BYTES = "\0bytes"  # a name that no plain data has


def user_folder() -> Path:
    """$DELTACT_FAB_CACHE, else deltact-fab in the user's cache folder; it need not exist."""
    if named := os.environ.get(FOLDER_VARIABLE):
        return Path(named)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "deltact-fab"


def key(
    *code: str, package: Path = digest.PACKAGE, libraries: tuple[str, ...] = (), **given: Any
) -> dict[str, Any]:
    """The key of a result: its code, what decides it beside the code, and what it was made from.

    code, package: as of `digest.of`. libraries: distributions whose versions count, and with them
    the machine. given: plain data and dataclasses.
    """
    made_by = _versions(libraries) if libraries else {}
    return {"code": digest.of(*code, package=package), "made_by": made_by, **plain(given)}


def plain(value: Any) -> Any:
    """Nested dataclasses as JSON holds them, each with the name of its class."""
    if is_dataclass(value) and not isinstance(value, type):
        inside = {f.name: plain(getattr(value, f.name)) for f in fields(value)}
        return {"class": type(value).__name__, **inside}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    # What it does is in the digest of the sources.
    return value.__qualname__ if callable(value) else value


@functools.cache
def _versions(libraries: tuple[str, ...]) -> dict[str, str]:
    found = {
        "deltact-fab": VERSION,
        "machine": platform.machine(),
        "zlib": zlib.ZLIB_RUNTIME_VERSION,
    }
    for name in libraries:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "absent"
    return found


def get(kind: str, key: dict[str, Any]) -> Any | None:
    """The value stored under a key, or None; a damaged entry counts as none.

    It is as `packed` and `unpacked` give it back.
    """
    key, path = _place(kind, key)
    try:
        head, newline, data = path.read_bytes().partition(b"\n")
        entry = json.loads(head)
    except (OSError, ValueError):
        return None
    if not (newline and isinstance(entry, dict) and entry.keys() >= {"key", "value", "sha256"}):
        return None
    if entry["key"] != key or entry["sha256"] != _seal(key, entry["value"], data):
        return None
    # Its last use, which `trim` goes by.
    with contextlib.suppress(OSError):
        os.utime(path)
    return unpacked(entry["value"], data)


def put(kind: str, key: dict[str, Any], value: Any, limit_bytes: int | None = None) -> bool:
    """Store a value under a key, whole or not at all; False when the folder refuses.

    limit_bytes: what the kind may take of the disk; the longest unused entries make room. Raises
    TypeError as `packed`.
    """
    key, path = _place(kind, key)
    value, data = packed(value)
    head = {"key": key, "value": value, "sha256": _seal(key, value, data)}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole(path, sync=False) as part:
            part.write_bytes(json.dumps(head).encode() + b"\n" + data)
    except OSError:
        return False
    if limit_bytes is not None:
        trim(kind, limit_bytes)
    return True


def packed(value: Any) -> tuple[Any, bytes]:
    """JSON data in which the type and shape of each array and of bytes stand for it; their bytes.

    Tuples become lists. Raises TypeError for what is neither plain data nor an array of numbers or
    texts.
    """
    import numpy as np  # here, for `doctor` tells of one that is broken

    parts: list[bytes] = []

    def told(one: Any) -> Any:
        if isinstance(one, Mapping):
            return {name: told(inner) for name, inner in one.items()}
        if isinstance(one, list | tuple):
            return [told(inner) for inner in one]
        if isinstance(one, bytes):
            parts.append(one)
            return {_BYTES: ["bytes", [len(one)]]}
        if isinstance(one, np.ndarray):
            if one.dtype.hasobject or one.dtype.names:
                raise TypeError(f"an array of {one.dtype} cannot be kept")
            parts.append(one.tobytes())
            return {_BYTES: [one.dtype.str, one.shape]}
        return one

    return _json(told(value)), b"".join(parts)


def unpacked(value: Any, data: bytes) -> Any:
    """The value of what `packed` gave."""
    import numpy as np

    at = 0

    def told(one: Any) -> Any:
        nonlocal at
        if isinstance(one, list):
            return [told(inner) for inner in one]
        if not isinstance(one, dict):
            return one
        if _BYTES not in one:
            return {name: told(inner) for name, inner in one.items()}
        start, (kind, shape) = at, one[_BYTES]
        if kind == "bytes":
            at += shape[0]
            return data[start:at]
        array = np.ndarray(shape, kind, data, start).copy()
        at += array.nbytes
        return array

    return told(value)


def file_of(kind: str, key: dict[str, Any]) -> Path:
    """Where `put` under a key leaves its file, from the user's folder: it may be copied there."""
    return _place(kind, key)[1].relative_to(user_folder())


def copy_in(name: str, data: bytes) -> None:
    """A file of another machine's store into this one's; where the folder refuses, nothing."""
    path = user_folder() / name
    with contextlib.suppress(OSError):
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            with whole(path, sync=False) as part:
                part.write_bytes(data)


def copy_out(names: Iterable[str]) -> dict[str, bytes]:
    """Of these files of the store the bytes of those that are there."""
    found = {}
    for name in names:
        with contextlib.suppress(OSError):
            found[name] = (user_folder() / name).read_bytes()
    return found


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


def _seal(key: Any, value: Any, data: bytes) -> str:
    return hashlib.sha256(_text([key, value]) + b"\n" + data).hexdigest()


def _place(kind: str, key: dict[str, Any]) -> tuple[dict[str, Any], Path]:
    """A key as JSON gives it back, and where its entry lies."""
    name = hashlib.sha256(_text(key)).hexdigest()
    return _json(key), user_folder() / kind / f"{name}.bin"


def _text(data: Any) -> bytes:
    return json.dumps(data, sort_keys=True, separators=(",", ":")).encode()


def _json(data: Any) -> Any:
    return json.loads(json.dumps(data))
