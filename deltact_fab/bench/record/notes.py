"""Operators' notes on a run, which may be added at any time.

They are lines of JSON in RUN/notes.jsonl, not in the journal: only the process that executes the
run writes that, and never after the end.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from deltact_fab.common import InputError, RunFailed, disk_errors, parse_json, sync_folder

from .files import NOTES_FILE
from .folder import MAX_RUN_FILE_BYTES, UnsafeFile, check_folder, has_file, open_file, read_file

MAX_DAMAGED_NOTES = 1000  # by hand: more are no damage but another file
MAX_NOTE_CHARACTERS = 4000  # by hand: one write call stores a note whole


class RunNote:
    """Operator's note for a run."""

    def __init__(self, text: str) -> None:
        """Strip and check the text. Raises InputError if empty, too long or not printable."""
        self.text = text = text.strip()
        if not 0 < len(text) <= MAX_NOTE_CHARACTERS:
            raise InputError(f"note: {len(text)} characters; expected 1 to {MAX_NOTE_CHARACTERS}")
        if odd := [c for c in text if not c.isprintable() and c not in "\n\t"]:
            raise InputError(f"note: {odd[0]!r} is not printable; remove it")

    def add_to(self, folder: Path) -> dict[str, Any]:
        """Append the note to a run and return it: text, wall_s.

        Safe during the run. Raises InputError if there is no run folder, RunFailed for a disk
        error.
        """
        check_folder(folder)
        if not has_file(folder, "run.json"):
            raise InputError(f"{folder}: not a run folder (no run.json)")
        note = {"wall_s": time.time(), "text": self.text}
        path = folder / NOTES_FILE
        new = not path.exists()
        with disk_errors(path):
            with open_file(folder, NOTES_FILE, "a+b") as file:
                end = file.seek(0, os.SEEK_END)
                file.seek(max(end - 1, 0))
                torn = file.read(1) not in (b"", b"\n")  # a writer died midway
                line = json.dumps({**note, "sha256": _digest(note)})
                data = b"\n" * torn + line.encode() + b"\n"
                if end + len(data) > (limit := MAX_RUN_FILE_BYTES[path.suffix]):
                    raise InputError(f"{path}: full: {limit >> 20} MiB of notes")
                if file.write(data) != len(data):
                    raise RunFailed(f"{path}: cannot be written: the disk is full")
                os.fsync(file.fileno())
            if new:
                sync_folder(folder)
        return note


def read_notes(folder: Path) -> Iterator[tuple[int, dict[str, Any] | None]]:
    """Yield (line number from 1, note) in order of writing; note is None if damaged.

    Keys of a note: wall_s, text, hashed (False for lines of 0.2.0, which have no hash). Raises
    RunFailed if the file cannot be read.
    """
    path = folder / NOTES_FILE
    with disk_errors(path, "read"):
        has_notes = has_file(folder, NOTES_FILE)
        raw_lines = read_file(folder, NOTES_FILE).splitlines() if has_notes else []
    damaged = 0
    for number, line in enumerate(raw_lines, start=1):
        try:
            entry = parse_json(line.decode(), f"{path}:{number}")
            note = {"wall_s": float(entry["wall_s"]), "text": str(entry["text"])}
            if "sha256" in entry and entry["sha256"] != _digest(note):
                raise ValueError("differs from its hash")
            yield number, {**note, "hashed": "sha256" in entry}
        except (InputError, ValueError, KeyError, TypeError):
            damaged += 1
            if damaged > MAX_DAMAGED_NOTES:
                text = f"more than {MAX_DAMAGED_NOTES} lines are no notes"
                raise UnsafeFile(f"{path}: {text}") from None
            yield number, None


def _digest(note: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps([note["wall_s"], note["text"]]).encode()).hexdigest()
