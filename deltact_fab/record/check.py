"""Whether a run folder holds what its plan asks for, whole: every row, image, sample and truth."""

from __future__ import annotations

import sqlite3
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .. import catalog
from ..aliases import Progress
from ..errors import DeltactFabError, InputError, RunFailed
from ..protocols.plan import Protocol, Step, expand
from . import notes
from .files import truth_file, written
from .journal import being_written
from .kept_presses import FileAndHash, by_press, damages, frame_id_of, frame_ids, unsound
from .run import Run

WITHOUT_PLAN = (2, 3)  # formats whose protocols this version does not expand any more


@dataclass(frozen=True)
class Damage:
    """One thing that is wrong. kind: damaged, missing, extra or differs; where: file or id."""

    kind: str
    where: str
    text: str

    def line(self) -> str:
        """One line for a person."""
        return f"{self.kind}  {self.where}: {self.text}"


@dataclass
class RunVerdict:
    """What was found in a run folder; it is whole when there is no problem.

    presses, frames: planned; whole_presses: complete, every hash right; lost_frames: that did not
    come when they were wanted, as the run itself counted. open: presses that an
    unfinished run has begun and not completed, with the reason: no damage, `--resume` does them.
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
    open: dict[str, str] = field(default_factory=dict)
    problems: list[Damage] = field(default_factory=list)

    @property
    def whole(self) -> bool:
        """Nothing is damaged, and a finished run has all of its plan."""
        return not self.problems

    def line(self) -> str:
        """The verdict in a line."""
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

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            **{k: v for k, v in vars(self).items() if k not in ("folder", "problems")},
            "folder": str(self.folder),
            "whole": self.whole,
            "problems": [vars(problem) for problem in self.problems],
        }


def check(folder: Path, progress: Progress | None = None) -> RunVerdict:
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
    for number in notes.damaged_lines(folder):
        add(Damage("damaged", "notes.jsonl", f"line {number} is no note"))
    steps: list[Step] = []
    if run.format not in WITHOUT_PLAN:
        try:
            steps = planned(run)
        except InputError as why:
            add(Damage("damaged", "protocol.toml", str(why)))
    try:
        with run.reader() as db:
            db.execute("BEGIN")  # one moment of a run that goes on
            broken = [Damage("damaged", "journal.sqlite", line) for line in unsound(db)]
            verdict.problems += broken
            if not broken:
                verdict.problems += _judge(run, db, steps, verdict, progress)
    except RunFailed as why:
        add(Damage("damaged", "journal.sqlite", str(why)))
    if run.finished and steps:
        verdict.problems += _summary(run, steps)
    return verdict


def planned(run: Run) -> list[Step]:
    """The steps that the run's protocol becomes.

    Raises InputError when protocol.toml cannot be read or says something else than run.json.
    """
    path = run.folder / "protocol.toml"
    protocol = catalog.validate(Protocol, catalog.read(path), str(path))
    source = f"{run.folder / 'run.json'}: protocol"
    if catalog.validate(Protocol, run.meta.get("protocol"), source) != protocol:
        raise InputError(f"{path}: differs from the protocol in run.json")
    return expand(protocol, bool(run.meta.get("air")))


def require_whole(run: Run, progress: Progress | None = None) -> None:
    """Raise RunFailed, naming the first file, when a finished run is not whole any more.

    Costs what a resume pays for the presses it keeps: about 1 ms of processor time a frame of
    2 MB, and the reading of it.
    """
    found = [p for p in check(run.folder, progress).problems if p.kind != "extra"]
    if found:
        more = f", and {len(found) - 1} more (`record check` lists them)" if len(found) > 1 else ""
        raise RunFailed(
            f"{run.folder}: finished, and damaged since: {found[0].where}: {found[0].text}{more}; "
            "put it back from a copy, or remove summary.json and --resume does that press again"
        )


def _judge(
    run: Run,
    db: sqlite3.Connection,
    steps: Sequence[Step],
    verdict: RunVerdict,
    progress: Progress | None,
) -> Iterator[Damage]:
    """steps: of the plan; none where it is not known, and rows are held against files only."""
    done = {row[0]: row[1:] for row in db.execute("SELECT step_id, seq, press FROM steps")}
    found: dict[str, FileAndHash] = {}
    placed: dict[str, tuple[Any, ...]] = {}
    for frame_id, file, digest, *place in db.execute(
        "SELECT frame_id, file, sha256, seq, step_id, press, k FROM frames ORDER BY seq"
    ):
        found[frame_id], placed[frame_id] = (file, digest), tuple(place)
    if steps:
        yield from _differences(steps, done, placed)
    ids = {press: frame_ids(part) + [s.id for s in part] for press, part in by_press(steps).items()}
    if not steps:
        for frame_id, (_, _, press, _) in placed.items():
            ids.setdefault(press, []).append(frame_id)
    changes = {step.press for step in steps if step.kind == "change"}
    verdict.presses, verdict.found_frames = len(ids.keys() - changes), len(found)
    verdict.frames = sum(step.frames for step in steps) or len(found)
    verdict.images = sum(file is not None for file, _ in found.values())
    lost = _lost(run, db, steps, found)
    verdict.lost_frames = len(lost)
    checked = 0
    for press, part in ids.items():
        missing = [i for i in part if not (i in found or i in done or i in lost)]
        if missing and not run.finished:  # a resume does it again, whatever is there of it
            if len(missing) < len(part):
                verdict.open[press] = _lacks(missing, part)
            continue
        if missing:
            yield Damage("missing", press, _lacks(missing, part))
        frames = {i: found[i] for i in part if i in found}
        lines = list(damages(run, press, frames))
        yield from (Damage("damaged", press, line) for line in lines)
        verdict.whole_presses += not missing and not lines and press not in changes
        checked += len(frames)
        if progress is not None and frames:
            progress(checked, len(found), f"checking {press}")
    if run.finished:  # what a cut-off press left is cleared by the resume
        yield from _strays(run, {file for file, _ in found.values() if file}, ids)


def _lost(
    run: Run, db: sqlite3.Connection, steps: Sequence[Step], found: Container[str]
) -> set[str]:
    """Ids of frames that did not come, as many as their steps say: counted, and no damage."""
    if run.format is None or run.format < 5:
        return set()
    missed = dict(db.execute("SELECT step_id, missed FROM steps"))
    lost: set[str] = set()
    for step in steps:
        lost.update([i for i in frame_ids([step]) if i not in found][: missed.get(step.id, 0)])
    return lost


def _lacks(missing: Sequence[str], part: Sequence[str]) -> str:
    return f"not in the journal: {len(missing)} of {len(part)} frames and steps, from {missing[0]}"


def _differences(
    steps: Sequence[Step],
    done: dict[str, tuple[Any, ...]],
    placed: dict[str, tuple[Any, ...]],
) -> Iterator[Damage]:
    """Rows that the plan does not have, or that stand in another place than it gives them."""
    wanted_steps = {step.id: (n, step.press) for n, step in enumerate(steps, start=1)}
    wanted_frames: dict[str, tuple[Any, ...]] = {}
    for step in steps:
        for k in range(1, step.frames + 1):
            place = (len(wanted_frames) + 1, step.id, step.press, k)
            wanted_frames[frame_id_of(step, k)] = place
    for what, wanted, rows in (
        ("step", wanted_steps, done),
        ("frame", wanted_frames, placed),
    ):
        for row_id, place in rows.items():
            if row_id not in wanted:
                yield Damage("extra", row_id, f"a {what} that the protocol does not have")
            elif place != wanted[row_id]:
                text = f"the {what} stands at {place}, the protocol has it at {wanted[row_id]}"
                yield Damage("differs", row_id, text)


def _strays(run: Run, named: Iterable[str], plan: Iterable[str]) -> Iterator[Damage]:
    known = {run.folder / file for file in named}
    known |= {truth_file(run.folder, press) for press in plan}
    for path in sorted(written(run.folder)):
        if path not in known:
            yield Damage("extra", str(path.relative_to(run.folder)), "no row names it")


def _summary(run: Run, steps: Sequence[Step]) -> Iterator[Damage]:
    try:
        said = run.summary()
    except DeltactFabError as why:
        yield Damage("damaged", "summary.json", str(why))
        return
    for key, count in (("steps", len(steps)), ("frames", sum(s.frames for s in steps))):
        if said.get(key) != count:
            text = f"{key} = {said.get(key)}, the protocol has {count}"
            yield Damage("differs", "summary.json", text)
