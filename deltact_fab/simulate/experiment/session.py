"""Run a protocol, or some of its presses, on any rig and record it; dry runs without motion."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Protocol

from deltact_fab.bench import (
    RigConfig,
    RigSetup,
    RunNote,
    RunProgress,
    RunWriter,
    SensorLedger,
    VirtualConfig,
    carry_out_steps,
    check_run,
    expand_protocol,
    open_run,
    require_same_conditions,
)
from deltact_fab.common import InputError, Note, toml_text
from deltact_fab.fabricate import PatternRecipe
from deltact_fab.sensor import describe_indenters
from deltact_fab.version import library_versions

from .request import RunRequest

if TYPE_CHECKING:
    from ..virtual.rig import VirtualRig

AIR_RUN = Note(
    "air", "air run: heights below the clearance plane were raised to it; nothing was touched"
)


class EarlyEnd(Protocol):
    """Rule by which a run ends before its protocol does.

    meta: kept in `run.json`. extending: a finished run goes on.
    """

    meta: dict[str, Any]
    extending: bool

    def __call__(self, complete: Sequence[str]) -> tuple[bool, str]:
        """Decide by the names of the complete presses, see `carry_out_steps`."""

    def summary(self) -> dict[str, Any]:
        """Return the figures of the decisions, for the run's summary."""

    def remark(self) -> Note:
        """Return the last decision in a line."""


def run_experiment(
    request: RunRequest,
    *,
    resume: bool = False,
    note: str | None = None,
    live: Callable[[RunProgress], None] | None = None,
    early_end: EarlyEnd | None = None,
) -> dict[str, Any]:
    """Check everything, run every step, return the summary.

    resume: continue the unfinished run in the request's folder, or start it when there is none; a
    finished one is verified (every hash) and left as it is, and its summary comes with
    "already_finished" true. The run is added to the ledger of its sensor; "ledger" has what that
    leaves to tell. The summary's times, counts, notes and devices are those of the last
    session. note: kept with the run. live: shown what goes on. early_end: may end the run; the
    presses and changes before which it ends are "skipped". Raises InputError or RunFailed.
    """
    started = time.monotonic()
    remark = None if note is None else RunNote(note)
    out, rig, steps, protocol = request.out, request.rig, request.steps, request.protocol
    job = request.setup(out)
    text = request.source.read_bytes()
    meta = run_metadata(job, rig, request.rig_name)
    pattern, truth = request.recipe.as_record(), request.kind.truth(protocol, request.design)
    extending = early_end is not None and early_end.extending
    resuming = out.exists() and (resume or extending)
    if early_end is not None:
        meta["until"] = early_end.meta
    if request.extends is not None:
        meta["extends"] = open_run(request.extends).id
    if resuming:
        recorded = open_run(out)
        if "extends" in recorded.meta:  # named once, when it began
            meta.setdefault("extends", recorded.meta["extends"])
        require_same_conditions(recorded, meta, text, pattern, truth, extending)
        if recorded.finished and note is not None:
            raise InputError(f"--note: {out} has finished; `deltact-fab record note` adds to it")
        if recorded.finished:
            check_run(out, request.progress).require_intact()
        if recorded.finished and not extending:
            ledger = SensorLedger.add_event("run", [out])
            return {**recorded.summary(), "already_finished": True, "ledger": ledger}
    else:
        _require_new(out, text)
    warnings = request.require()
    if resuming:
        writer = RunWriter.resume(out, steps, request.progress)
        (out / "summary.json").unlink(missing_ok=True)  # of a finished run, which goes on
    else:
        flat = request.kind.flat(protocol)
        writer = RunWriter.create(out, meta, text, pattern, steps, flat, truth)
    try:
        if remark is not None:
            remark.add_to(out)
        ledger = SensorLedger.add_event("run", [out])  # now, as a run may be killed
        with closing(request.kind.build(job, request.progress)) as bench:
            counts, rig_seconds = carry_out_steps(
                bench, steps, writer, request.progress, live, early_end
            )
            kept_frames = sum(step.frames for step in steps if step.press in writer.kept_presses)
            remarks = [*bench.notes(), *warnings, *_resumed(writer.session, kept_frames)]
            remarks += [Note("ledger", line, warns=True) for line in ledger]
            if early_end is not None:
                remarks.insert(0, early_end.remark())
            if request.air:
                remarks.insert(0, AIR_RUN)
            steps = [step for step in steps if step.press not in writer.skipped]
            summary = {
                "protocol": protocol.name,
                "rig": request.rig_name,
                "simulated": meta["simulated"],
                "air": request.air,
                "seed": request.seed,
                "steps": len(steps),
                "frames": sum(step.frames for step in steps) - writer.missed,
                "missed_frames": writer.missed,
                "frame_counts": counts,
                "sessions": writer.session,
                "kept_frames": kept_frames,
                "redone": writer.redone,
                "rig_seconds": rig_seconds,
                "wall_seconds": time.monotonic() - started,
                "left_out": [note.labelled for note in bench.omissions()],
                "notes": [note.line for note in remarks],
                "remarks": [asdict(note) for note in remarks],
                "devices": bench.identity(),
            }  # fmt: skip
            if early_end is not None:
                summary |= {"skipped": list(writer.skipped), "until": early_end.summary()}
        writer.close(summary)
    finally:
        writer.abandon()  # no more than `close` has done
        ledger = SensorLedger.add_event("run", [out])
    return {**summary, "already_finished": False, "ledger": ledger}


def dry_run_experiment(request: RunRequest) -> dict[str, Any]:
    """Check all that a run checks, and ask the devices of a rig that has any; nothing moves.

    Returns steps, frames, seconds and disk_mb of the estimate, devices (a line each, empty on a
    rig in lockstep) and notes. Raises InputError or RunFailed, as the run would.
    """
    from deltact_fab.bench import ask_devices

    notes = [note.line for note in (*([AIR_RUN] if request.air else []), *request.require())]
    lines: list[str] = []
    if not request.rig.simulated:
        with TemporaryDirectory() as folder:
            job = request.setup(Path(folder) / "dry-run")
            with closing(request.kind.build(job, request.progress)) as bench:
                lines = ask_devices(bench)
    return {**asdict(request.estimate()), "devices": lines, "notes": notes}


def run_presses(
    job: RigSetup,
    rig: VirtualConfig,
    source: Path,
    presses: Collection[str],
    sensor: int | None = None,
) -> VirtualRig:
    """Carry out presses of a job, by name, alone, as the whole run has them.

    What a press gives depends on the seed and its name, not on what came before it; so presses can
    be carried out anywhere, in any order, and are those of the whole run but for the time of day.
    They are recorded into the job's folder. source: of the rig file, from which the paths in it
    count. sensor: number of the one that is drawn from the rig's population; None: the nominal one.
    What a run is checked for is left to the caller, and no monitor is read. Returns the rig,
    closed, for what it has to say of its gel. Raises InputError for a folder that is there,
    RunFailed.
    """
    from ..virtual.rig import VirtualKind

    plan = [s for s in expand_protocol(job.protocol) if s.kind == "change" or s.press in presses]
    steps = [
        step
        for step, following in zip(plan, [*plan[1:], plan[0]], strict=True)
        if not step.kind == following.kind == "change"  # nothing is pressed after it
    ]
    kind = VirtualKind(rig.model_copy(update={"monitor": None}), source, sensor)
    meta = run_metadata(job, rig, source.stem)
    text = toml_text(meta["protocol"]).encode()
    assert isinstance(job.recipe, PatternRecipe), "a virtual rig draws it"
    flat, truth = kind.flat(job.protocol), kind.truth(job.protocol, job.sensor)
    writer = RunWriter.create(job.folder, meta, text, job.recipe.as_record(), steps, flat, truth)
    try:
        with closing(kind.build(job)) as bench:
            carry_out_steps(bench, steps, writer)
        writer.close({"presses": sorted(presses)})
    finally:
        writer.abandon()  # no more than `close` has done
    return bench


def run_metadata(job: RigSetup, rig: RigConfig, rig_name: str) -> dict[str, Any]:
    """Contents of `run.json`: protocol, rig, sensor, camera, seed, versions."""
    return {
        "name": job.folder.name,
        "protocol": job.protocol.model_dump(mode="json"),
        "rig_name": rig_name,
        "rig": rig.recorded(),
        "sensor": asdict(job.sensor),
        "presses": [press.as_dict() for press in job.protocol.list_presses()],
        "shapes": describe_indenters(job.protocol.tips),
        "camera": job.view.as_dict() if job.view is not None else None,
        "simulated": rig.simulated or rig.served,
        "air": job.air,
        "seed": job.seed,
        "versions": library_versions(),
    }


def _require_new(out: Path, protocol: bytes) -> None:
    """Raise InputError when the folder is there, with what can be done about it."""
    if not out.exists():
        return
    hint = "name a new --out folder"
    try:
        recorded = open_run(out)
        if not recorded.finished and (out / "protocol.toml").read_bytes() == protocol:
            hint = "unfinished run of this protocol: continue with --resume, or " + hint
    except (OSError, InputError):
        pass
    raise InputError(f"{out}: already exists; {hint}")


def _resumed(sessions: int, kept_frames: int) -> Iterator[Note]:
    if sessions > 1:
        text = (
            f"resumed: session {sessions} kept {kept_frames} frames of earlier sessions; seconds "
            "and solved problems count this session only"
        )
        yield Note("resumed", text)
