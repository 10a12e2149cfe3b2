"""Carrying out a protocol on whatever rig, and its record; or all of it but the motion."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from .. import record
from ..aliases import Progress
from ..errors import InputError
from ..record import RunWriter
from ..record import open as open_run
from ..rig.run import query
from ..rig.run.live import Live
from ..rig.run.runner import Runner
from .meta import meta_of, pattern_of
from .preview import show
from .request import asked_for


def run(
    protocol_name: str,
    rig_name: str,
    out: Path,
    seed: int = 0,
    progress: Progress | None = None,
    resume: bool = False,
    air: bool = False,
    *,
    realtime: bool = False,
    unattended: bool = False,
    tip_is_clear: bool = False,
    note: str | None = None,
    live: Callable[[Live], None] | None = None,
) -> dict[str, Any]:
    """Check everything, run every step, return the summary.

    resume: continue the unfinished run in `out`, or start it when there is none; a finished one is
    verified (every hash) and left as it is, and its summary comes with "already_finished" true.
    The summary's times, counts, notes and devices are those of the last session. air: nothing goes
    below the clearance plane, and no force is predicted. realtime: a virtual rig runs on the wall
    clock, in a process of its own behind real wires. unattended: nobody is asked anything, and what
    would need that is refused. tip_is_clear: the operator's word, where the position is lost. note:
    kept with the run. live: shown what goes on. Raises InputError or RunFailed.
    """
    started = time.monotonic()
    if note is not None:
        note = record.usable_note(note)
    asked = asked_for(
        protocol_name, rig_name, out, seed, progress, air, realtime, unattended, tip_is_clear
    )
    job, rig, steps, protocol = asked.job, asked.rig, asked.steps, asked.job.protocol
    text = asked.source.read_bytes()
    meta = meta_of(asked, rig_name)
    if realtime:
        meta["realtime"] = True
    pattern = pattern_of(job.recipe)
    resuming = out.exists() and resume
    if resuming:
        found = open_run(out)
        record.require_same(found, meta, text, pattern, with_versions=not found.finished)
        if found.finished and note is not None:
            raise InputError(f"--note: {out} has finished; `deltact-fab record note` adds to it")
        if found.finished:
            record.require_whole(found, progress)
            return {**found.summary(), "already_finished": True}
    else:
        _require_new(out, text)
    warnings = asked.warnings(progress)
    if resuming:
        writer = RunWriter.resume(out, steps, progress)
    else:
        writer = RunWriter.create(out, meta, text, pattern, steps, asked.kind.flat(protocol))
    try:
        if note is not None:
            record.add_note(out, note)
        with closing(asked.kind.build(job)) as bench:
            devices = bench.devices()
            start_s = devices.clock.now_s()
            runner = Runner(devices, writer, progress, live)
            runner.run(steps)
            kept = sum(step.frames for step in steps if step.press in writer.kept)
            summary = {
                "protocol": protocol.name,
                "rig": rig_name,
                "simulated": rig.simulated,
                "realtime": realtime,
                "air": air,
                "seed": seed,
                "steps": len(steps),
                "frames": sum(step.frames for step in steps) - writer.missed,
                "missed_frames": writer.missed,
                "frame_counts": runner.counts(),
                "sessions": writer.session,
                "kept_frames": kept,
                "redone": writer.redone,
                "rig_seconds": devices.clock.now_s() - start_s,
                "wall_seconds": time.monotonic() - started,
                "left_out": bench.left_out(),
                "notes": [
                    *_air_note(air), *bench.notes(), *warnings,
                    *_resumed(writer.session, kept),
                ],
                "devices": bench.identity(),
            }  # fmt: skip
        writer.close(summary)
    except BaseException:
        writer.abandon()
        raise
    return {**summary, "already_finished": False}


def dry_run(
    protocol_name: str,
    rig_name: str,
    progress: Progress | None = None,
    air: bool = False,
    *,
    realtime: bool = False,
    unattended: bool = False,
    out: Path | None = None,
) -> dict[str, Any]:
    """Check all that a run checks, and ask the devices of a rig that has any; nothing moves.

    Returns steps, frames, seconds and disk_mb of the estimate, devices (a line each, empty on a
    rig in lockstep) and notes. Raises InputError or RunFailed, as the run would.
    """
    with TemporaryDirectory() as folder:
        asked = asked_for(
            protocol_name, rig_name, Path(folder) / "dry-run", 0, progress, air, realtime,
            unattended, False, out or Path(),
        )  # fmt: skip
        notes = [*_air_note(air), *asked.warnings(progress)]
        _, estimate = show(protocol_name, rig_name, air, realtime)
        lines: list[str] = []
        if realtime or not asked.rig.simulated:
            with closing(asked.kind.build(asked.job)) as bench:
                lines = query.devices(bench.devices())
    return {**estimate.as_dict(), "devices": lines, "notes": notes}


def _air_note(air: bool) -> list[str]:
    if not air:
        return []
    return ["an air run: the clearance plane stood for every height below it; nothing was touched"]


def _require_new(out: Path, protocol: bytes) -> None:
    """Raise InputError when the folder is there, with what can be done about it."""
    if not out.exists():
        return
    hint = "name a new --out folder"
    try:
        found = open_run(out)
        if not found.finished and (out / "protocol.toml").read_bytes() == protocol:
            hint = "an unfinished run of this protocol: go on with --resume, or " + hint
    except (OSError, InputError):
        pass
    raise InputError(f"{out}: already there; {hint}")


def _resumed(sessions: int, kept_frames: int) -> list[str]:
    if sessions == 1:
        return []
    return [
        f"resumed: session {sessions} kept {kept_frames} frames of those before it; seconds and "
        "solved problems count this session only"
    ]
