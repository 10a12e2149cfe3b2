"""Whether a run folder holds what its plan asks for, whole: every row, image, sample and truth."""

from __future__ import annotations

import hashlib
import sqlite3
import zipfile
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import InputError, Progress, RunFailed, read_toml, validate

from ..protocols.plan import Protocol, Step, expand_protocol
from . import notes
from .files import UNHASHED, TruthFiles, frame_id_of, metadata, written
from .journal import being_written
from .run import Run

FileAndHash = tuple[str | None, str | None]


@dataclass(frozen=True)
class Damage:
    """One thing that is wrong. kind: damaged, missing, extra or differs; where: file or id."""

    kind: str
    where: str
    text: str


@dataclass
class RunVerdict:
    """What was found in a run folder; it is whole when there is no problem.

    presses, frames: planned; whole_presses: complete, every hash right; lost_frames: that did not
    come when they were wanted, as the run itself counted. sound: whole presses and changes of the
    indenter, by name, which `--resume` keeps. open: presses that an unfinished run has begun and
    not completed, with the reason: no damage, `--resume` does them. unhashed: metadata that an
    older version wrote without a hash, so that a value that was changed in them may not be seen.
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
    unhashed: list[str] = field(default_factory=list)
    problems: list[Damage] = field(default_factory=list)

    @property
    def whole(self) -> bool:
        """Nothing is damaged, and a finished run has all of its plan."""
        return not self.problems

    @property
    def line(self) -> str:
        """The verdict in one line."""
        said = "whole" if self.whole else f"DAMAGED: {len(self.problems)} problems"
        end = "finished" if self.finished else "unfinished"
        if self.being_written:
            end = "being written now"
        lost = f" ({self.lost_frames} lost while it ran)" if self.lost_frames else ""
        return (
            f"{self.folder}: {said} ({end}): {self.whole_presses} of {self.presses} presses whole, "
            f"{self.found_frames} of {self.frames} frames{lost}, {self.images} images, "
            f"format {self.format}"
        )

    def rows(self) -> list[tuple[str, str, str]]:
        """Kind, place and text of each press that is not complete and of each problem."""
        rows = [("open", press, f"{why}; `run --resume` repeats it")
                for press, why in self.open.items()]  # fmt: skip
        if self.unhashed:
            text = (
                "written by an older version; what was changed in them since is seen only where it "
                "does not fit the rest"
            )
            rows.append(("not hashed", ", ".join(self.unhashed), text))
        return rows + [(one.kind, one.where, one.text) for one in self.problems]

    def require_whole(self) -> None:
        """Raise RunFailed, naming the first file, when a finished run is not whole any more."""
        found = [p for p in self.problems if p.kind != "extra"]
        if found:
            more = f", and {len(found) - 1} more (`record check` lists them)" * (len(found) > 1)
            raise RunFailed(
                f"{self.folder}: finished, and damaged since: {found[0].where}: {found[0].text}"
                f"{more}; put it back from a copy, or remove summary.json and --resume does that "
                "press again"
            )

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {**asdict(self), "folder": str(self.folder), "whole": self.whole}


def check_run(folder: Path, progress: Progress | None = None) -> RunVerdict:
    """Verify a run folder against its plan; nothing in it is changed.

    Reads every image (hash), unpacks every sample and truth. Raises InputError where there is no
    run folder.
    """
    if not (folder / "run.json").is_file():
        Run(folder)  # says what is there instead
    verdict = RunVerdict(folder)
    try:
        run = Run(folder)
    except InputError as why:
        verdict.problems.append(Damage("damaged", "run.json", str(why)))
        return verdict
    verdict.format, verdict.finished = run.format, run.finished
    verdict.being_written = being_written(folder)
    add = verdict.problems.append
    for number, note in notes.lines(folder):
        if note is None:
            add(Damage("damaged", "notes.jsonl", f"line {number} is no note, or was changed"))
        elif not note["hashed"]:
            verdict.unhashed.append(f"notes.jsonl:{number}")
    steps: list[Step] = []
    if not run.imported:
        try:
            steps = _planned(run)
        except InputError as why:
            add(Damage("damaged", "protocol.toml", str(why)))
    try:
        with run.reader() as db:
            db.execute("BEGIN")  # one moment of a run that goes on
            verdict.problems += judge(run, db, steps, verdict, progress)
            if run.format == UNHASHED:
                verdict.unhashed += [f for end in (False, True) for f in metadata(folder, end)]
            else:
                told = {problem.where for problem in verdict.problems}
                verdict.problems += [d for d in unlike_hashes(run, db) if d.where not in told]
    except RunFailed as why:
        add(Damage("damaged", "journal.sqlite", str(why)))
    if run.imported and not verdict.problems:
        verdict.problems += _uncounted(run)
    return verdict


def unlike_hashes(run: Run, db: sqlite3.Connection) -> Iterator[Damage]:
    """Metadata that are not, byte for byte, what the journal of a run of today has the hashes of.

    Of an unfinished run only what it began with is known.
    """
    hashes: dict[str, str] = dict(db.execute("SELECT file, sha256 FROM files"))
    begun, ended = metadata(run.folder, False), metadata(run.folder, True)
    late = {"summary.json", *ended, *(file for file in hashes if file.startswith("truth/"))}
    for file in sorted({*begun, *ended, *hashes}):
        if file in late and not run.finished:
            continue
        if file not in hashes:
            yield Damage("damaged", file, "the journal has no hash of it")
        elif file not in (*begun, *ended):
            yield Damage("missing", file, "the journal has its hash")
        elif why := _damage(run.folder / file, hashes[file]):
            yield Damage("damaged", file, why)


def _damage(path: Path, digest: str | None) -> str:
    """Why a file is not the one that was hashed; empty where it is."""
    try:
        data = path.read_bytes()
    except OSError as why:
        return str(why.strerror)
    same = hashlib.sha256(data).hexdigest() == digest
    return "" if same else "differs from its hash in the journal"


def _planned(run: Run) -> list[Step]:
    """The steps that the run's protocol becomes.

    Raises InputError when protocol.toml cannot be read.
    """
    path = run.folder / "protocol.toml"
    protocol = validate(Protocol, read_toml(path), str(path))
    return expand_protocol(protocol, bool(run.meta.get("air")))


def judge(
    run: Run,
    db: sqlite3.Connection,
    steps: Sequence[Step],
    verdict: RunVerdict,
    progress: Progress | None,
) -> Iterator[Damage]:
    """What is wrong with rows and files; counts, whole and open presses go into the verdict.

    steps: of the plan; none where it is not known, and rows are held against files only. Of a
    journal whose file or indices are broken nothing else is said.
    """
    broken = [line for (line,) in db.execute("PRAGMA integrity_check") if line != "ok"]
    if broken:
        yield from (Damage("damaged", "journal.sqlite", line) for line in broken)
        return
    done = {row[0]: row[1:] for row in db.execute("SELECT step_id, seq, press FROM steps")}
    found: dict[str, FileAndHash] = {}
    placed: dict[str, tuple[Any, ...]] = {}
    for frame_id, file, digest, *place in db.execute(
        "SELECT frame_id, file, sha256, seq, step_id, press, k FROM frames ORDER BY seq"
    ):
        found[frame_id], placed[frame_id] = (file, digest), tuple(place)
    ids: dict[str, list[str]] = {}
    for step in steps:
        ids.setdefault(step.press, []).extend([*_frame_ids(step), step.id])
    if steps:
        yield from _differences(steps, done, placed)
    else:
        for frame_id, (_, _, press, _) in placed.items():
            ids.setdefault(press, []).append(frame_id)
    changes = {step.press for step in steps if step.kind == "change"}
    verdict.presses, verdict.found_frames = len(ids.keys() - changes), len(found)
    verdict.frames = sum(step.frames for step in steps) or len(found)
    verdict.images = sum(file is not None for file, _ in found.values())
    lost = _lost(db, steps, found)
    verdict.lost_frames = len(lost)
    checked = 0
    for press, part in ids.items():
        missing = [i for i in part if not (i in found or i in done or i in lost)]
        lacks = f"not in the journal: {len(missing)} of {len(part)} frames and steps, from "
        if missing and not run.finished:  # a resume does it again, whatever is there of it
            if len(missing) < len(part):
                verdict.open[press] = lacks + missing[0]
            continue
        if missing:
            yield Damage("missing", press, lacks + missing[0])
        frames = {i: found[i] for i in part if i in found}
        lines = list(_damages(run, press, frames))
        yield from (Damage("damaged", press, line) for line in lines)
        if not missing and not lines:
            verdict.sound.append(press)
        checked += len(frames)
        if progress is not None and frames:
            progress(checked, len(found), f"checking {press}")
    verdict.whole_presses = len(set(verdict.sound) - changes)
    if run.finished:  # what a cut-off press left is cleared by the resume
        yield from _strays(run, {file for file, _ in found.values() if file}, ids)


def _frame_ids(step: Step) -> list[str]:
    """Ids of the frames of a step, in order of capture."""
    return [frame_id_of(step, k) for k in range(1, step.frames + 1)]


def _lost(db: sqlite3.Connection, steps: Sequence[Step], found: Container[str]) -> set[str]:
    """Ids of frames that did not come, as many as their steps say: counted, and no damage."""
    missed = dict(db.execute("SELECT step_id, missed FROM steps"))
    lost: set[str] = set()
    for step in steps:
        lost.update([i for i in _frame_ids(step) if i not in found][: missed.get(step.id, 0)])
    return lost


def _differences(
    steps: Sequence[Step],
    done: dict[str, tuple[Any, ...]],
    placed: dict[str, tuple[Any, ...]],
) -> Iterator[Damage]:
    """Rows that the plan does not have, or that stand in another place than it gives them."""
    wanted_steps = {step.id: (n, step.press) for n, step in enumerate(steps, start=1)}
    wanted_frames: dict[str, tuple[Any, ...]] = {}
    for step in steps:
        for k, frame_id in enumerate(_frame_ids(step), start=1):
            wanted_frames[frame_id] = (len(wanted_frames) + 1, step.id, step.press, k)
    for what, wanted, rows in (("step", wanted_steps, done), ("frame", wanted_frames, placed)):
        for row_id, place in rows.items():
            if row_id not in wanted:
                yield Damage("extra", row_id, f"a {what} that the protocol does not have")
            elif place != wanted[row_id]:
                text = f"the {what} stands at {place}, the protocol has it at {wanted[row_id]}"
                yield Damage("differs", row_id, text)


def _damages(run: Run, press: str, frames: Mapping[str, FileAndHash]) -> Iterator[str]:
    """What is wrong with the files of a press whose rows are all there, a line each."""
    drawn = False
    for file, digest in frames.values():
        if file is None:
            continue
        drawn = True
        if why := _damage(run.folder / file, digest):
            yield f"{file}: {why}"
    yield from run.damaged_samples(press)
    if drawn and run.simulated and run.meta["rig"]["kind"] == "virtual":
        yield from _truth_damages(run, press, list(frames))


def _truth_damages(run: Run, press: str, frame_ids: list[str]) -> Iterator[str]:
    files = TruthFiles(run.folder)
    lens = [files.lens] * ((run.meta["camera"] or {}).get("model") == "rectified")
    needed = [files.lattice, *lens, files.press(press)]
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


def _strays(run: Run, named: Iterable[str], plan: Iterable[str]) -> Iterator[Damage]:
    known = {run.folder / file for file in named}
    known |= {TruthFiles(run.folder).press(press) for press in plan}
    for path in sorted(written(run.folder)):
        if path not in known:
            yield Damage("extra", str(path.relative_to(run.folder)), "no row names it")


def _uncounted(run: Run) -> Iterator[Damage]:
    """Where the journal of an imported run, which has no plan, differs from what was counted."""
    said = run.summary()
    if not said:
        yield Damage("missing", "summary.json", "without it an import is not known to be whole")
        return
    with run.reader() as db:
        found = dict(db.execute("SELECT stream, sum(n) FROM samples GROUP BY stream"))
        found["frames"] = db.execute("SELECT count(*) FROM frames").fetchone()[0]
    wanted = {"frames": said.get("frames"), **(said.get("samples") or {})}
    for what, count in wanted.items():
        if found.get(what) != count:
            text = f"{found.get(what)} of {what}, and {count} were imported"
            yield Damage("differs", "journal.sqlite", text)
