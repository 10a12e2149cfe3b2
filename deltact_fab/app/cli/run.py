"""`deltact-fab run`: carry out a protocol on a rig."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from deltact_fab.common import check_writable, format_duration

from .options import NAME_OR_PATH, PATH_TYPE, RIG_OPTION, SENSOR_OPTION, TIP_IS_CLEAR, seed
from .output import Answer, answers, progress


@click.command(epilog="Example: deltact-fab run smoke --rig virtual --seed 3 --out smoke-run")
@click.argument("protocol", type=NAME_OR_PATH)
@RIG_OPTION
@seed("Seed of all random numbers.")
@SENSOR_OPTION
@click.option("--out", type=PATH_TYPE, metavar="DIR", help="New folder for the run.")
@click.option("--resume", is_flag=True, help="Continue the unfinished run in --out.")
@click.option("--air", is_flag=True, help="Touch nothing: never go below the clearance plane.")
@click.option("--unattended", is_flag=True, help="Run without prompts; refuse if one would be "
              "needed.")  # fmt: skip
@click.option("--until", metavar="GOAL", help="Goal at which the run ends, such as "
              '"normal 0.1N": rms error of the force.')  # fmt: skip
@click.option("--extend", type=click.IntRange(1), metavar="N", help="Continue the run in --out, "
              "which ended by --until, by N presses of its list.")  # fmt: skip
@click.option("--extends", type=PATH_TYPE, metavar="RUN", help="Earlier run that this one extends "
              "by more presses; its id is recorded.")  # fmt: skip
@TIP_IS_CLEAR
@click.option("--note", metavar="TEXT", help="Note to save with the run.")
@click.option("--dry-run", is_flag=True,
              help="Check everything and query each device, but move nothing.")  # fmt: skip
@answers
def run(
    protocol: str, rig_name: str, seed: int, sensor: int | None, out: Path | None, resume: bool,
    air: bool, unattended: bool, until: str | None, extend: int | None, extends: Path | None,
    tip_is_clear: bool, note: str | None, dry_run: bool,
) -> Answer:  # fmt: skip
    """Carry out PROTOCOL on a rig and record it in a new folder.

    With --resume an interrupted run continues: complete presses are kept, the interrupted one is
    repeated. If there is no folder yet, the run starts; a finished run is not changed.

    On a real rig (kind = "grbl") you type the names of the sensor and of each indenter once they
    are mounted, and the face is located as configured in [touch] before the first press. If the
    position was lost and the force sensor cannot decide, you are asked whether the tip is clear of
    the gel. With --unattended there are no prompts: the protocol must have one indenter and the
    face must be located by force.

    With --until, the model of the presses of role "fit" is tested on those of role "validate" after
    each block of presses: from one reference press to the next, or eight. The run ends as soon as
    its rms error of normal, shear_x, shear_y (N), torque_x, torque_y or torque_z (Nmm) is below the
    goal with confidence: of runs whose error is not, at most one in twenty ends as "reached". The
    tip waits above the face meanwhile, and the guard goes on. Without it, all presses are made.

    The first Ctrl-C stops and lifts the tip; the second resets the controller immediately.
    Ctrl-Z or SIGUSR1 pauses the run before its next press, homed as it is, and again continues it;
    so does a [[monitor]] of the rig file while its value is unknown or beyond its limits.
    --dry-run makes all checks of a run and queries each device of a real rig; it needs no --out,
    moves nothing and records nothing.
    """
    from deltact_fab.simulate import RunRequest, dry_run_experiment, run_experiment
    from deltact_fab.studies import GoalLooks

    if resume and extend is not None:
        raise click.UsageError("--extend continues a finished run, --resume an unfinished one.")
    if out is None and not dry_run:
        raise click.UsageError("Missing option '--out': the folder of the new run.")
    if out is not None and not resume:  # a finished run may be read only
        check_writable(out, folder=True)
    with progress("dry run" if dry_run else "run") as report:
        request = RunRequest(
            protocol, rig_name, out or Path(), 0 if dry_run else seed, report, air,
            unattended=unattended, tip_is_clear=tip_is_clear, sensor=sensor, extends=extends,
        )  # fmt: skip
        looks = GoalLooks.of_request(request, until, extend, resume and not dry_run)
        if dry_run:
            plan = dry_run_experiment(request)
        else:
            summary = run_experiment(
                request, resume=resume, note=note,
                live=lambda state: report(state.frames_done, state.frames_total, state.line()),
                early_end=looks,
            )  # fmt: skip
    if dry_run:
        text = (
            f"{protocol} on {rig_name}: {plan['steps']} steps, {plan['presses']} presses, "
            f"{plan['frames']} frames, about {format_duration(plan['seconds'])}, "
            f"{plan['disk_mb']:.0f} MB; nothing was moved or recorded"
        )
        return Answer(plan, [text, *(f"  {state}" for state in (*plan["devices"], *plan["notes"]))])
    return Answer(summary, _run_lines(summary, out), asides=summary["ledger"])


def _run_lines(summary: dict[str, Any], out: Path | None) -> Iterator[str]:
    if summary["already_finished"]:
        yield f"{out}: already finished, {summary['frames']} frames; nothing changed"
        return
    if summary["sessions"] > 1:
        yield f"{out}: resumed, {summary['kept_frames']} frames kept"
        yield from (f"  repeated: {press}: {text}" for press, text in summary["redone"].items())
    mode = " (simulated)" if summary["simulated"] else ""
    mode += " in air" if summary["air"] else ""
    yield (
        f"{out}: {summary['frames']} frames of {summary['protocol']} on {summary['rig']}{mode}, "
        f"seed {summary['seed']}: "
        f"{'simulated ' if summary['simulated'] else ''}{summary['rig_seconds']:.1f} s in "
        f"{summary['wall_seconds']:.1f} s"
    )
    if "until" in summary:
        remark = next(note["text"] for note in summary["remarks"] if note["id"] == "until")
        yield f"  {remark}; {len(summary['skipped'])} presses and changes skipped"
    yield from (f"  {kind}: {n}" for kind, n in summary["frame_counts"].items())
    yield from (f"  not built: {line}" for line in summary["left_out"])
