"""Verification of a run folder against its plan: every row, image, sample and truth."""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from deltact_fab.common import InputError, Progress, RunFailed

from ..protocols.plan import Step
from . import notes
from .files import (
    LATTICE_FILE,
    LENS_FILE,
    SENSOR_FILE,
    UNHASHED_FORMAT,
    frame_id_of,
    metadata_files,
    truth_file,
    written_files,
)
from .folder import check_folder, has_file, read_file
from .journal import is_claimed
from .run import Run
from .truth import ARRAY_ERRORS, open_arrays

FileAndHash = tuple[str | None, str | None]


@dataclass(frozen=True)
class Damage:
    """One fault of a run folder. kind: damaged, missing, extra or differs; where: file or id."""

    kind: str
    where: str
    text: str


@dataclass
class RunVerdict:
    """Result of verifying a run folder; the run is intact if there are no problems.

    presses, frames: planned; whole_presses: complete, all hashes match; lost_frames: that the
    camera did not deliver, as counted by the run. sound: complete presses and indenter changes by
    name; `--resume` keeps them. open: presses that an unfinished run began but did not complete,
    with the reason; no damage, `--resume` repeats them. skipped: presses and changes of indenter
    before which the run ended; not counted as planned. unhashed: metadata that an older version
    wrote without a hash, in which a changed value may go unnoticed.
    """

    folder: Path
    format: int | None = None
    finished: bool = False
    being_written: bool = False
    presses: int = 0
    whole_presses: int = 0
    frames: int = 0
    found_frames: int = 0
    lost_frames: int = 0
    images: int = 0
    sound: list[str] = field(default_factory=list)
    open: dict[str, str] = field(default_factory=dict)
    skipped: list[str] = field(default_factory=list)
    unhashed: list[str] = field(default_factory=list)
    problems: list[Damage] = field(default_factory=list)

    @property
    def intact(self) -> bool:
        """True if nothing is damaged and a finished run contains its whole plan."""
        return not self.problems

    @property
    def line(self) -> str:
        """Verdict in one line."""
        condition = "intact" if self.intact else f"DAMAGED ({len(self.problems)} problems)"
        state = "finished" if self.finished else "unfinished"
        if self.being_written:
            state = "being written now"
        skipped = f", {len(self.skipped)} presses and changes skipped" if self.skipped else ""
        lost_note = f" ({self.lost_frames} lost by the camera)" if self.lost_frames else ""
        return (
            f"{self.folder}: {condition}, {state}: {self.whole_presses}/{self.presses} presses "
            f"complete{skipped}, {self.found_frames}/{self.frames} frames{lost_note}, "
            f"{self.images} images, format {self.format}"
        )

    def rows(self) -> list[tuple[str, str, str]]:
        """Kind, location and text of each incomplete press and each problem."""
        rows = [("open", press, f"{reason}; `run --resume` repeats it")
                for press, reason in self.open.items()]  # fmt: skip
        if self.unhashed:
            text = (
                "written by an older version without hashes; changes are detected only if "
                "inconsistent with the rest"
            )
            rows.append(("not hashed", ", ".join(self.unhashed), text))
        return rows + [(problem.kind, problem.where, problem.text) for problem in self.problems]

    def require_intact(self) -> None:
        """Raise RunFailed, naming the first file, if a finished run has been damaged."""
        faults = [p for p in self.problems if p.kind != "extra"]
        if faults:
            rest = f", and {len(faults) - 1} more (`record check` lists them)" * (len(faults) > 1)
            raise RunFailed(
                f"{self.folder}: damaged after its end: {faults[0].where}: {faults[0].text}{rest}; "
                "restore it from a copy, or remove summary.json and repeat that press with --resume"
            )

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {**asdict(self), "folder": str(self.folder), "whole": self.intact}


def check_run(folder: Path, progress: Progress | None = None) -> RunVerdict:
    """Verify a run folder against its plan, without changing anything.

    Hashes every image and unpacks every sample and truth. Raises InputError if there is no run
    folder.
    """
    check_folder(folder)
    if not has_file(folder, "run.json"):
        Run(folder)  # raises the specific error
    verdict = RunVerdict(folder)
    try:
        run = Run(folder)
    except InputError as error:
        verdict.problems.append(Damage("damaged", "run.json", str(error)))
        return verdict
    verdict.format, verdict.finished = run.format, run.finished
    verdict.being_written = is_claimed(folder)
    add = verdict.problems.append
    for number, note in notes.read_notes(folder):
        if note is None:
            add(Damage("damaged", "notes.jsonl", f"line {number} is not a note or was changed"))
        elif not note["hashed"]:
            verdict.unhashed.append(f"notes.jsonl:{number}")
    steps: list[Step] = []
    if not run.imported:
        try:
            verdict.skipped, steps = _skipped(run), run.planned_steps()
            steps = [step for step in steps if step.press not in verdict.skipped]
        except InputError as error:
            add(Damage("damaged", "protocol.toml", str(error)))
    try:
        with run.reader() as db:
            db.execute("BEGIN")  # one snapshot of a running run
            verdict.problems += find_damage(run, db, steps, verdict, progress)
            if run.format == UNHASHED_FORMAT:
                verdict.unhashed += metadata_files(folder, False) + metadata_files(folder, True)
            else:
                reported = {problem.where for problem in verdict.problems}
                verdict.problems += [d for d in hash_mismatches(run, db) if d.where not in reported]
    except RunFailed as error:
        add(Damage("damaged", "journal.sqlite", str(error)))
    if run.imported and not verdict.problems:
        verdict.problems += _count_mismatches(run)
    return verdict


def _skipped(run: Run) -> list[str]:
    """Names of what an early end skipped; none if the summary, damaged, does not tell."""
    try:
        return run.skipped
    except RunFailed:
        return []


def hash_mismatches(run: Run, db: sqlite3.Connection) -> Iterator[Damage]:
    """Metadata files whose SHA-256 differs from the journal (runs of the current format).

    For an unfinished run, only the files written at its start are checked.
    """
    hashes: dict[str, str] = dict(db.execute("SELECT file, sha256 FROM files"))
    begun, ended = metadata_files(run.folder, False), metadata_files(run.folder, True)
    truths = (file for file in hashes if file.startswith("truth/") and file != SENSOR_FILE)
    late = {"summary.json", *ended, *truths}
    for file in sorted({*begun, *ended, *hashes}):
        if file in late and not run.finished:
            continue
        if file not in hashes:
            yield Damage("damaged", file, "no hash in the journal")
        elif file not in (*begun, *ended):
            yield Damage("missing", file, "listed in the journal")
        elif mismatch := _file_damage(run, file, hashes[file]):
            yield Damage("damaged", file, mismatch)


def _file_damage(run: Run, file: str, digest: str | None) -> str:
    """Return why a file does not match its hash; empty if it does."""
    try:
        data = read_file(run.folder, file)
    except OSError as error:
        return str(error.strerror)
    same = hashlib.sha256(data).hexdigest() == digest
    return "" if same else "differs from its hash in the journal"


def find_damage(
    run: Run,
    db: sqlite3.Connection,
    steps: Sequence[Step],
    verdict: RunVerdict,
    progress: Progress | None,
) -> Iterator[Damage]:
    """Yield faults of rows and files; fill counts, sound and open presses of `verdict`.

    steps: planned; empty if unknown: then rows are compared with files only. If the journal's file
    or indices are corrupt, only that is reported.
    """
    broken = [line for (line,) in db.execute("PRAGMA integrity_check") if line != "ok"]
    if broken:
        yield from (Damage("damaged", "journal.sqlite", line) for line in broken)
        return
    step_rows = {row[0]: row[1:] for row in db.execute("SELECT step_id, seq, press FROM steps")}
    frame_files: dict[str, FileAndHash] = {}
    frame_rows: dict[str, tuple[Any, ...]] = {}
    for frame_id, file, digest, *place in db.execute(
        "SELECT frame_id, file, sha256, seq, step_id, press, k FROM frames ORDER BY seq"
    ):
        frame_files[frame_id], frame_rows[frame_id] = (file, digest), tuple(place)
    ids: dict[str, list[str]] = {}
    for step in steps:
        ids.setdefault(step.press, []).extend([*_frame_ids(step), step.id])
    if steps:
        yield from _differences(steps, step_rows, frame_rows)
    else:
        for frame_id, (_, _, press, _) in frame_rows.items():
            ids.setdefault(press, []).append(frame_id)
    changes = {step.press for step in steps if step.kind == "change"}
    verdict.presses, verdict.found_frames = len(ids.keys() - changes), len(frame_files)
    verdict.frames = sum(step.frames for step in steps) or len(frame_files)
    verdict.images = sum(file is not None for file, _ in frame_files.values())
    lost_ids = _lost_ids(db, steps, frame_files)
    verdict.lost_frames = len(lost_ids)
    checked = 0
    for press, part in ids.items():
        missing = [i for i in part if not (i in frame_files or i in step_rows or i in lost_ids)]
        lacks = f"not in the journal: {len(missing)} of {len(part)} frames and steps, from "
        if missing and not run.finished:  # a resume repeats it in any case
            if len(missing) < len(part):
                verdict.open[press] = lacks + missing[0]
            continue
        if missing:
            yield Damage("missing", press, lacks + missing[0])
        frames = {i: frame_files[i] for i in part if i in frame_files}
        lines = list(_press_damage(run, press, frames))
        yield from (Damage("damaged", press, line) for line in lines)
        if not missing and not lines:
            verdict.sound.append(press)
        checked += len(frames)
        if progress is not None and frames:
            progress(checked, len(frame_files), f"checking {press}")
    verdict.whole_presses = len(set(verdict.sound) - changes)
    if run.finished:  # what a cut-off press left is cleared by the resume
        yield from _stray_files(run, {file for file, _ in frame_files.values() if file}, ids)


def _frame_ids(step: Step) -> list[str]:
    """Frame ids of a step, in order of capture."""
    return [frame_id_of(step, k) for k in range(1, step.frames + 1)]


def _lost_ids(db: sqlite3.Connection, steps: Sequence[Step], received: Container[str]) -> set[str]:
    """Ids of frames that the camera dropped, up to each step's `missed` count; not damage."""
    missed = dict(db.execute("SELECT step_id, missed FROM steps"))
    lost_ids: set[str] = set()
    for step in steps:
        absent = [i for i in _frame_ids(step) if i not in received]
        lost_ids.update(absent[: missed.get(step.id, 0)])
    return lost_ids


def _differences(
    steps: Sequence[Step],
    step_rows: dict[str, tuple[Any, ...]],
    frame_rows: dict[str, tuple[Any, ...]],
) -> Iterator[Damage]:
    """Yield rows that are not in the plan, or at another position than planned."""
    planned_steps = {step.id: (n, step.press) for n, step in enumerate(steps, start=1)}
    planned_frames: dict[str, tuple[Any, ...]] = {}
    for step in steps:
        for k, frame_id in enumerate(_frame_ids(step), start=1):
            planned_frames[frame_id] = (len(planned_frames) + 1, step.id, step.press, k)
    tables = ("step", planned_steps, step_rows), ("frame", planned_frames, frame_rows)
    for kind, planned, rows in tables:
        for row_id, place in rows.items():
            if row_id not in planned:
                yield Damage("extra", row_id, f"{kind} not in the protocol")
            elif place != planned[row_id]:
                text = f"{kind} at {place}, planned at {planned[row_id]}"
                yield Damage("differs", row_id, text)


def _press_damage(run: Run, press: str, frames: Mapping[str, FileAndHash]) -> Iterator[str]:
    """Yield faults of the files of a press whose rows are complete, one line each."""
    has_images = False
    for file, digest in frames.values():
        if file is None:
            continue
        has_images = True
        if damage := _file_damage(run, file, digest):
            yield f"{file}: {damage}"
    yield from run.damaged_samples(press)
    if has_images and run.simulated and run.meta["rig"]["kind"] == "virtual":
        yield from _truth_damage(run, press, list(frames))


def _truth_damage(run: Run, press: str, frame_ids: list[str]) -> Iterator[str]:
    lens = [LENS_FILE] * ((run.meta["camera"] or {}).get("model") == "rectified")
    for name in (LATTICE_FILE, *lens, truth_file(press)):
        if not has_file(run.folder, name):
            yield f"{name}: truth missing"
            return
    try:
        with open_arrays(run.folder, name) as data:
            bad, ids = data.zip.testzip(), data["frame_id"]
    except ARRAY_ERRORS as error:
        yield f"{name}: truth damaged: {error}"
        return
    if bad is not None or ids.shape != (len(frame_ids),) or ids.tolist() != frame_ids:
        yield f"{name}: truth damaged"


def _stray_files(run: Run, row_files: Iterable[str], plan: Iterable[str]) -> Iterator[Damage]:
    expected = {run.folder / file for file in row_files}
    expected |= {run.folder / truth_file(press) for press in plan}
    for path in sorted(written_files(run.folder)):
        if path not in expected:
            yield Damage("extra", str(path.relative_to(run.folder)), "not listed in the journal")


def _count_mismatches(run: Run) -> Iterator[Damage]:
    """Yield differences between the journal of an imported run and its summary's counts."""
    summary = run.summary()
    if not summary:
        yield Damage("missing", "summary.json", "needed to verify an import")
        return
    with run.reader() as db:
        counts = dict(db.execute("SELECT stream, sum(n) FROM samples GROUP BY stream"))
        counts["frames"] = db.execute("SELECT count(*) FROM frames").fetchone()[0]
    expected = {"frames": summary.get("frames"), **(summary.get("samples") or {})}
    for name, count in expected.items():
        if counts.get(name) != count:
            text = f"{counts.get(name)} of {name}, but {count} were imported"
            yield Damage("differs", "journal.sqlite", text)
