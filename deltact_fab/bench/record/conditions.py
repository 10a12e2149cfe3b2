"""Resume check: a run may be continued only under the conditions it began with."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from deltact_fab.common import InputError

from .files import RUN_FORMAT, SENSOR_FILE, json_bytes, read_record
from .folder import has_file, read_file
from .run import Run

# Keys that may differ on resume: they change no result and no file.
_MAY_DIFFER = (
    "format", "name", "presses", "rig_name", "rig.stage.port", "rig.stage.registration",
    "rig.camera.model", "rig.camera.source", "rig.monitor", "versions.python", "versions.cadquery",
)  # fmt: skip


def require_same_conditions(
    run: Run,
    meta: dict[str, Any],
    protocol: bytes,
    pattern: dict[str, Any],
    truth: dict[str, Any] | None,
    extending: bool = False,
) -> None:
    """Refuse to resume a run whose conditions have changed.

    meta, protocol, pattern, truth: as for `RunWriter.create`. extending: the run has finished, and
    is to go on. Raises InputError naming the first
    key that differs, with its stored and its current value.
    """
    if run.format != RUN_FORMAT:
        raise InputError(
            f"{run.folder}: cannot be resumed: format {run.format} is of an older version, for "
            "reading only"
        )
    number = None if truth is None else truth["number"]
    current = json.loads(json_bytes({**meta, "pattern": pattern, "--sensor": number}))
    stored = {**run.meta, "pattern": run.pattern}
    if has_file(run.folder, SENSOR_FILE):
        stored["--sensor"] = read_record(run.folder, SENSOR_FILE).get("number")
    # User input first, derived values after.
    parts = ("protocol", "seed", "rig", "--sensor", "sensor", "pattern", *current, *stored)
    for part in dict.fromkeys(parts):
        if part == "versions" and run.finished and not extending:
            continue
        difference = _first_difference(stored.get(part), current.get(part), part)
        if difference is not None:
            key, old, new = difference
            raise InputError(
                f"{run.folder}: cannot be resumed: {key}: {_shorten(old)} in the folder, "
                f"{_shorten(new)} now; conditions must not change during a run"
            )
    protocol_path = run.folder / "protocol.toml"
    try:
        recorded = read_file(run.folder, "protocol.toml")
    except OSError as error:
        raise InputError(f"{protocol_path}: cannot be read: {error.strerror}") from error
    if recorded != protocol:
        old, new = (hashlib.sha256(text).hexdigest()[:12] for text in (recorded, protocol))
        raise InputError(
            f"{run.folder}: cannot be resumed: protocol.toml: SHA-256 {old} in the folder, {new} "
            f"now (same values, other text); resume with {protocol_path}"
        )


def _first_difference(a: Any, b: Any, key_path: str) -> tuple[str, Any, Any] | None:
    """First difference between two trees of plain data: key path and both values.

    A missing key counts as None: a field added by a later version was not used.
    """
    if key_path in _MAY_DIFFER:
        return None
    if isinstance(a, dict) and isinstance(b, dict):
        for key in sorted(a.keys() | b.keys()):
            difference = _first_difference(a.get(key), b.get(key), f"{key_path}.{key}")
            if difference is not None:
                return difference
        return None
    return None if a == b else (key_path, a, b)


def _shorten(value: Any) -> str:
    if value is None:
        return "nothing"
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
