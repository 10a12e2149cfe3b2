"""`deltact-fab run`: carry out a protocol on a rig."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from deltact_fab.common import check_writable, format_duration

from .options import NAME_OR_PATH, PATH, RIG, TIP_IS_CLEAR, seed
from .output import Answer, answers, progress


@click.command(epilog="Example: deltact-fab run smoke --rig virtual --seed 3 --out smoke-run")
@click.argument("protocol", type=NAME_OR_PATH)
@RIG
@seed("Seed of everything random.")
@click.option("--out", type=PATH, metavar="DIR", help="New folder for the run.")
@click.option("--resume", is_flag=True, help="Continue the unfinished run in --out.")
@click.option("--air", is_flag=True, help="Touch nothing: never go below the clearance plane.")
@click.option("--unattended", is_flag=True, help="Run without prompts; refuse what would need an "
              "answer.")  # fmt: skip
@TIP_IS_CLEAR
@click.option("--note", metavar="TEXT", help="A remark to keep with the run.")
@click.option("--dry-run", is_flag=True,
              help="Check everything and query each device, but move nothing.")  # fmt: skip
@answers
def run(
    protocol: str, rig_name: str, seed: int, out: Path | None, resume: bool, air: bool,
    unattended: bool, tip_is_clear: bool, note: str | None, dry_run: bool,
) -> Answer:  # fmt: skip
    """Carry out PROTOCOL on a rig and record it in a new folder.

    With --resume an interrupted run continues: complete presses are kept, the interrupted one is
    repeated from its start. If there is no folder yet, the run starts; a finished run is left as it
    is.

    A real rig (kind = "grbl") has you type the name of the sensor and of each indenter once they
    are mounted, and finds the face as [touch] of its rig file says before it presses. If the
    position was lost and the force sensor cannot tell, it asks whether the tip is clear of the gel.
    With --unattended it asks nothing, so the protocol must have one indenter and the face must be
    found by force.

    The first Ctrl-C stops and lifts the tip; the second resets the controller at once. --dry-run
    makes all checks of a run and queries each device of a real rig; it needs no --out, moves
    nothing and records nothing.
    """
    from deltact_fab.simulate import RunRequest, dry_run_experiment, run_experiment

    if out is None and not dry_run:
        raise click.UsageError("Missing option '--out': the folder of the new run.")
    if out is not None and not resume:  # a finished run may be read only
        check_writable(out, folder=True)
    with progress("dry run" if dry_run else "run") as report:
        request = RunRequest(
            protocol, rig_name, out or Path(), 0 if dry_run else seed, report, air,
            unattended=unattended, tip_is_clear=tip_is_clear,
        )  # fmt: skip
        if dry_run:
            found = dry_run_experiment(request)
        else:
            summary = run_experiment(
                request, resume=resume, note=note,
                live=lambda it: report(it.frames_done, it.frames_total, it.line()),
            )  # fmt: skip
    if dry_run:
        told = (
            f"{protocol} on {rig_name}: {found['steps']} steps, {found['presses']} presses, "
            f"{found['frames']} frames, about {format_duration(found['seconds'])} of rig time, "
            f"{found['disk_mb']:.0f} MB; nothing was moved or recorded"
        )
        return Answer(found, [told, *(f"  {it}" for it in (*found["devices"], *found["notes"]))])
    return Answer(summary, _run_lines(summary, out))


def _run_lines(summary: dict[str, Any], out: Path | None) -> Iterator[str]:
    if summary["already_finished"]:
        yield f"{out}: finished before, {summary['frames']} frames; nothing was changed"
        return
    if summary["sessions"] > 1:
        yield f"{out}: resumed, {summary['kept_frames']} frames kept"
        yield from (f"  done again: {press}: {why}" for press, why in summary["redone"].items())
    how = " (simulated)" if summary["simulated"] else ""
    how += " in air" if summary["air"] else ""
    yield (
        f"{out}: {summary['frames']} frames of {summary['protocol']} on {summary['rig']}{how}, "
        f"seed {summary['seed']}: "
        f"{summary['rig_seconds']:.1f} s of rig time in {summary['wall_seconds']:.1f} s"
    )
    yield from (f"  {kind}: {n}" for kind, n in summary["frame_counts"].items())
    yield from (f"  left out: {line}" for line in summary["left_out"])
