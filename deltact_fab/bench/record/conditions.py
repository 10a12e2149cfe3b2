"""Whether a run may be continued: under the conditions it was begun with, or not at all."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from deltact_fab.common import InputError

from .files import FORMAT, json_bytes
from .run import Run

# What a run may be continued with although it differs: it changes no number and no byte.
_MAY_DIFFER = (
    "format", "name", "rig_name", "rig.stage.port", "rig.stage.registration", "rig.camera.model",
    "rig.camera.source", "versions.python", "versions.cadquery",
)  # fmt: skip


def require_same_conditions(
    run: Run,
    meta: dict[str, Any],
    protocol: bytes,
    pattern: dict[str, Any],
    with_versions: bool = True,
) -> None:
    """Refuse to go on with a run under other conditions than those of its beginning.

    meta, protocol, pattern: as for `RunWriter.create`. Raises InputError naming the first thing
    that differs, its value in the folder and its value now.
    """
    if run.format != FORMAT:
        raise InputError(
            f"{run.folder}: cannot be resumed: format {run.format}, of an older version; it can be "
            "read, checked and analysed"
        )
    given = json.loads(json_bytes({**meta, "pattern": pattern}))
    stored = {**run.meta, "pattern": run.pattern}
    # What a user gave comes before what follows from it.
    for part in dict.fromkeys(("protocol", "seed", "rig", "sensor", "pattern", *given, *stored)):
        if part == "versions" and not with_versions:
            continue
        found = _difference(stored.get(part), given.get(part), part)
        if found is not None:
            key, was, now = found
            raise InputError(
                f"{run.folder}: cannot be resumed: {key}: {_short(was)} in the folder, "
                f"{_short(now)} now; a run must end under the conditions it began with"
            )
    kept = run.folder / "protocol.toml"
    try:
        before = kept.read_bytes()
    except OSError as why:
        raise InputError(f"{kept}: cannot be read: {why.strerror}") from why
    if before != protocol:
        was, now = (hashlib.sha256(text).hexdigest()[:12] for text in (before, protocol))
        raise InputError(
            f"{run.folder}: cannot be resumed: protocol.toml: SHA-256 {was} in the folder, {now} "
            f"now: the same values in another text; resume with {kept}"
        )


def _difference(a: Any, b: Any, at: str) -> tuple[str, Any, Any] | None:
    """The first place where two trees of plain data differ: its key and both values.

    What is not there is None: a field that was not known to who began the run was not used.
    """
    if at in _MAY_DIFFER:
        return None
    if isinstance(a, dict) and isinstance(b, dict):
        for key in sorted(a.keys() | b.keys()):
            found = _difference(a.get(key), b.get(key), f"{at}.{key}")
            if found is not None:
                return found
        return None
    return None if a == b else (at, a, b)


def _short(value: Any) -> str:
    if value is None:
        return "nothing"
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
