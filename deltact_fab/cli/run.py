"""`deltact-fab run`: carry out a protocol on a rig."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .options import SEED


@click.command()
@click.argument("protocol")
@click.option(
    "--rig", "rig_name", default="virtual", show_default=True, help="Rig file, by name or path."
)
@click.option("--seed", type=SEED, default=0, show_default=True, help="Of all that is drawn.")
@click.option("--out", type=click.Path(path_type=Path), help="New run folder.")
@click.option("--resume", is_flag=True, help="Go on with the unfinished run in --out.")
@click.option("--air", is_flag=True, help="Touch nothing: no height below the clearance plane.")
@click.option("--realtime", is_flag=True, help="A virtual rig in real time, on real wires.")
@click.option("--unattended", is_flag=True, help="Nobody is there: ask nothing; refuse what would.")
@click.option("--tip-is-clear", is_flag=True, help="You say that the tip touches nothing: home.")
@click.option("--note", help="A remark to keep with the run.")
@click.option("--dry-run", is_flag=True, help="Check all, ask each device, move nothing.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def run(
    protocol: str,
    rig_name: str,
    seed: int,
    out: Path | None,
    resume: bool,
    air: bool,
    realtime: bool,
    unattended: bool,
    tip_is_clear: bool,
    note: str | None,
    dry_run: bool,
    as_json: bool,
) -> None:
    """Run PROTOCOL on a rig and record it in a new folder.

    With --resume an interrupted run goes on: complete presses are kept, the interrupted one is
    done again whole. Where there is no folder yet the run starts; a finished one stays as it is.

    A real rig (kind = "grbl") asks to type the name of the sensor and of each indenter once they
    are mounted, and finds the face by [touch] of its rig file before it presses. With --unattended
    it asks nothing: a protocol of one indenter, found by force, or it is refused. Where the
    position was lost and the force sensor cannot tell, it asks whether the tip is clear of the gel.

    The first Ctrl-C stops and lifts the tip; the second resets the controller at once. --dry-run
    makes every check of a run and asks each device of a real rig, needs no --out, and neither moves
    nor records anything.
    """
    from .. import experiment
    from .output import echo_json, progress

    if dry_run:
        with progress("dry run") as report:
            found = experiment.dry_run(
                protocol, rig_name, report, air,
                realtime=realtime, unattended=unattended, out=out,
            )  # fmt: skip
        echo_json(found) if as_json else _tell_dry_run(found, protocol, rig_name)
        return
    if out is None:
        raise click.UsageError("Missing option '--out': the folder of the new run.")
    with progress("run") as report:
        summary = experiment.run(
            protocol, rig_name, out, seed, report, resume, air,
            realtime=realtime, unattended=unattended, tip_is_clear=tip_is_clear, note=note,
            live=lambda it: report(it.done, it.total, it.line()),
        )  # fmt: skip
    if as_json:
        echo_json(summary)
        return
    if summary["already_finished"]:
        click.echo(f"{out}: finished before, {summary['frames']} frames; nothing was changed")
        return
    if summary["sessions"] > 1:
        click.echo(f"{out}: resumed, {summary['kept_frames']} frames kept")
        for press, why in summary["redone"].items():
            click.echo(f"  done again: {press}: {why}")
    click.echo(
        f"{out}: {summary['frames']} frames of {summary['protocol']} on {summary['rig']}"
        f"{' (simulated)' if summary['simulated'] else ''}{' in air' if summary['air'] else ''}, "
        f"seed {seed}: "
        f"{summary['rig_seconds']:.1f} s of rig time in {summary['wall_seconds']:.1f} s"
    )
    for kind, n in summary["frame_counts"].items():
        click.echo(f"  {kind}: {n}")
    for line in summary["left_out"]:
        click.echo(f"  left out: {line}")


def _tell_dry_run(found: dict[str, Any], protocol: str, rig_name: str) -> None:
    from ..rig.run.live import duration

    click.echo(
        f"{protocol} on {rig_name}: {found['steps']} steps, {found['presses']} presses, "
        f"{found['frames']} frames, about {duration(found['seconds'])}, {found['disk_mb']:.0f} MB; "
        "nothing was moved or recorded"
    )
    for line in (*found["devices"], *found["notes"]):
        click.echo(f"  {line}")
