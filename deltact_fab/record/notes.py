"""An operator's notes on a run, which may be written by anyone at any time.

They stand in RUN/notes.jsonl, a line of JSON each, and not in the journal: that belongs to the one
process that carries the run out, and is not touched any more once it has finished.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .. import reading
from ..errors import InputError, RunFailed
from .files import notes_file, sync_folder

LONGEST = 4000  # characters: so that one write of the file system holds a note whole


def add(folder: Path, text: str) -> dict[str, Any]:
    """Append a note to a run and return it: text, wall_s.

    Safe while the run goes on. Raises InputError for no run folder and no usable text, RunFailed
    when the disk refuses.
    """
    if not (folder / "run.json").is_file():
        raise InputError(f"{folder}: not a run folder (no run.json)")
    note = {"wall_s": time.time(), "text": usable(text)}
    path = notes_file(folder)
    new = not path.exists()
    try:
        handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            size = os.fstat(handle).st_size
            torn = size > 0 and _last_byte(path) != b"\n"  # by a process that died in the middle
            data = b"\n" * torn + json.dumps(note).encode() + b"\n"
            if os.write(handle, data) != len(data):
                raise RunFailed(f"{path}: cannot be written: the disk is full")
            os.fsync(handle)
        finally:
            os.close(handle)
        if new:
            sync_folder(folder)
    except OSError as why:
        raise RunFailed(f"{path}: cannot be written: {why.strerror}") from why
    return note


def usable(text: str) -> str:
    """A note's text without blanks at its ends. Raises InputError for what is no note."""
    text = text.strip()
    if not 0 < len(text) <= LONGEST:
        raise InputError(f"note: {len(text)} characters; expected 1 to {LONGEST}")
    if odd := [c for c in text if not c.isprintable() and c not in "\n\t"]:
        raise InputError(f"note: {odd[0]!r} is no character that can be printed; leave it out")
    return text


def read(folder: Path) -> list[dict[str, Any]]:
    """All notes of a run in the order of writing. A line that is damaged is left out."""
    return [note for _, note in _lines(folder) if note is not None]


def damaged_lines(folder: Path) -> list[int]:
    """Numbers, from 1, of the lines that hold no note."""
    return [number for number, note in _lines(folder) if note is None]


def _lines(folder: Path) -> Iterator[tuple[int, dict[str, Any] | None]]:
    path = notes_file(folder)
    try:
        lines = path.read_bytes().splitlines() if path.exists() else []
    except OSError as why:
        raise RunFailed(f"{path}: cannot be read: {why.strerror}") from why
    for number, line in enumerate(lines, start=1):
        try:
            note = reading.json_text(line.decode(), f"{path}:{number}")
            yield number, {"wall_s": float(note["wall_s"]), "text": str(note["text"])}
        except (InputError, ValueError, KeyError, TypeError):
            yield number, None


def _last_byte(path: Path) -> bytes:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1)
