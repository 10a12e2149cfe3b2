"""Which presses of an interrupted run are kept: those that journal and disk hold whole."""

from __future__ import annotations

import hashlib
import sqlite3
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from ..aliases import Progress
from ..protocols.plan import Step
from .files import lattice_file, lens_file, truth_file
from .run import Run

FileAndHash = tuple[str | None, str | None]


def frame_id_of(step: Step, k: int) -> str:
    """Id of the k-th frame of a step, from 1."""
    return f"{step.id}#{k:03d}"


def by_press(steps: Iterable[Step]) -> dict[str, list[Step]]:
    """The steps of each press, in order."""
    plan: dict[str, list[Step]] = {}
    for step in steps:
        plan.setdefault(step.press, []).append(step)
    return plan


def frame_ids(steps: Iterable[Step]) -> list[str]:
    """Ids of all frames of these steps, in order of capture."""
    return [frame_id_of(step, k) for step in steps for k in range(1, step.frames + 1)]


def unsound(db: sqlite3.Connection, most: int = 100) -> Iterator[str]:
    """What SQLite finds wrong with the journal's file, its indices and its unique ids."""
    for (line,) in db.execute(f"PRAGMA integrity_check({most})"):
        if line != "ok":
            yield line


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
    for verdict in unsound(db, 1):
        raise sqlite3.DatabaseError(verdict)
    missed = dict(db.execute("SELECT step_id, missed FROM steps"))
    found = {
        frame_id: (file, digest)
        for frame_id, file, digest in db.execute("SELECT frame_id, file, sha256 FROM frames")
    }
    checked = 0
    kept = set()
    for press, part in by_press(steps).items():
        ids = frame_ids(part)
        have = [i for i in ids if i in found]
        if not have and not any(step.id in missed for step in part):
            continue
        gone = sum(missed.get(step.id, 0) for step in part)
        if len(have) + gone < len(ids) or any(step.id not in missed for step in part):
            redone[press] = f"cut off after {len(have)} of {len(ids)} frames"
            continue
        why = next(damages(run, press, {i: found[i] for i in have}), "")
        checked += len(have)
        if progress is not None and have:
            progress(checked, len(found), f"checking {press}")
        if why:
            redone[press] = why
        else:
            kept.add(press)
    return frozenset(kept), redone


def damages(run: Run, press: str, frames: Mapping[str, FileAndHash]) -> Iterator[str]:
    """What is wrong with the files of a press whose rows are all there, a line each."""
    drawn = False
    for file, digest in frames.values():
        if file is None:
            continue
        drawn = True
        try:
            data = (run.folder / file).read_bytes()
        except OSError as why:
            yield f"{file}: {why.strerror}"
            continue
        if hashlib.sha256(data).hexdigest() != digest:
            yield f"{file}: differs from its hash in the journal"
    if run.format != 2:
        for which in run.damaged_samples(press):
            yield f"its samples are damaged: {which}"
    if drawn and run.simulated:
        yield from _truth_damages(run, press, list(frames))


def _truth_damages(run: Run, press: str, frame_ids: list[str]) -> Iterator[str]:
    needed = [lattice_file(run.folder)]
    if (run.meta["camera"] or {}).get("model") == "rectified":
        needed.append(lens_file(run.folder))
    needed.append(truth_file(run.folder, press))
    for path in needed:
        if not path.is_file():
            yield f"{path.relative_to(run.folder)}: its truth is missing"
            return
    name = needed[-1].relative_to(run.folder)
    try:
        with zipfile.ZipFile(needed[-1]) as packed:
            bad = packed.testzip()
        with np.load(needed[-1]) as data:
            ids = data["frame_id"].tolist()
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as why:
        yield f"{name}: its truth is damaged: {why}"
        return
    if bad is not None or ids != frame_ids:
        yield f"{name}: its truth is damaged"
