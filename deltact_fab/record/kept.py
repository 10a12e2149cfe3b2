"""Which presses of an interrupted run are kept: those that journal and disk hold whole."""

from __future__ import annotations

import hashlib
import sqlite3
import zipfile
from collections.abc import Callable, Sequence

import numpy as np

from ..errors import RunFailed
from ..protocols.plan import Step
from .files import lattice_file, lens_file, truth_file
from .run import Run

Progress = Callable[[int, int, str], None]


def frame_id_of(step: Step, k: int) -> str:
    """Id of the k-th frame of a step, from 1."""
    return f"{step.id}#{k:03d}"


def judged(
    db: sqlite3.Connection, run: Run, steps: Sequence[Step], progress: Progress | None
) -> tuple[frozenset[str], dict[str, str]]:
    """Presses that are complete and whole, and those that are not, with the reason.

    A press is kept when all its steps and frames are journalled, less those frames that its steps
    count as missed, every image has its hash, and its
    samples and its truth are whole. Presses that were not begun are in neither.
    Raises sqlite3.DatabaseError for a damaged journal.
    """
    redone = {}
    verdict = db.execute("PRAGMA quick_check(1)").fetchone()[0]
    if verdict != "ok":
        raise sqlite3.DatabaseError(verdict)
    missed = dict(db.execute("SELECT step_id, missed FROM steps"))
    found = {
        frame_id: (file, digest)
        for frame_id, file, digest in db.execute("SELECT frame_id, file, sha256 FROM frames")
    }
    plan: dict[str, list[Step]] = {}
    for step in steps:
        plan.setdefault(step.press, []).append(step)
    checked = 0
    kept = set()
    for press, part in plan.items():
        ids = [frame_id_of(step, k) for step in part for k in range(1, step.frames + 1)]
        have = [i for i in ids if i in found]
        if not have and not any(step.id in missed for step in part):
            continue
        gone = sum(missed.get(step.id, 0) for step in part)
        if len(have) + gone < len(ids) or any(step.id not in missed for step in part):
            redone[press] = f"cut off after {len(have)} of {len(ids)} frames"
            continue
        why = _damage(run, press, {i: found[i] for i in have})
        checked += len(have)
        if progress is not None and have:
            progress(checked, len(found), f"checking {press}")
        if why:
            redone[press] = why
        else:
            kept.add(press)
    return frozenset(kept), redone


def _damage(run: Run, press: str, frames: dict[str, tuple[str | None, str | None]]) -> str:
    """What is wrong with the files of a press whose rows are all there; empty when nothing."""
    drawn = False
    for file, digest in frames.values():
        if file is None:
            continue
        drawn = True
        try:
            data = (run.folder / file).read_bytes()
        except OSError as why:
            return f"{file}: {why.strerror}"
        if hashlib.sha256(data).hexdigest() != digest:
            return f"{file}: differs from its hash in the journal"
    try:
        for _ in run.samples_of(press):
            pass
    except RunFailed:
        return "its samples are damaged"
    if drawn and run.simulated:
        needed = [lattice_file(run.folder)]
        if (run.meta["camera"] or {}).get("model") == "rectified":
            needed.append(lens_file(run.folder))
        if not all(path.is_file() for path in needed):
            return "its truth is missing"
        path = truth_file(run.folder, press)
        try:
            with zipfile.ZipFile(path) as packed:
                bad = packed.testzip()
            with np.load(path) as data:
                ids = data["frame_id"].tolist()
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            return "its truth is missing or damaged"
        if bad is not None or ids != list(frames):
            return "its truth is damaged"
    return ""
