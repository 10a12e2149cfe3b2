"""`deltact-fab run`: carry out a protocol on a rig."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("protocol")
@click.option("--rig", "rig_name", default="virtual", show_default=True, help="Rig file.")
@click.option("--seed", default=0, show_default=True, help="Of everything that is drawn.")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="New run folder.")
@click.option("--resume", is_flag=True, help="Go on with the unfinished run in --out.")
@click.option("--air", is_flag=True, help="Touch nothing: no height below the clearance plane.")
@click.option("--realtime", is_flag=True, help="A virtual rig on the wall clock, on real wires.")
@click.option("--unattended", is_flag=True, help="Nobody is there: ask nothing, or refuse.")
@click.option("--tip-is-clear", is_flag=True, help="Your word: the tip touches nothing. Home.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def run(
    protocol: str,
    rig_name: str,
    seed: int,
    out: Path,
    resume: bool,
    air: bool,
    realtime: bool,
    unattended: bool,
    tip_is_clear: bool,
    as_json: bool,
) -> None:
    """Run PROTOCOL on a rig and record it in a new folder.

    With --resume an interrupted run goes on: complete presses are kept, the interrupted one is
    done again whole. Where there is no folder yet the run starts; a finished one stays as it is.

    A real rig (kind = "grbl") asks to type the name of the sensor and of each indenter once they
    are mounted, and finds the face by [touch] of its rig file before it presses. With --unattended
    it asks nothing: a protocol of one indenter, found by force, or it is refused. Where the
    position was lost and the force sensor cannot tell, it asks whether the tip is clear of the gel.
    """
    from ..experiment import run as carry_out
    from .output import echo_json, progress

    with progress("run") as report:
        summary = carry_out(
            protocol, rig_name, out, seed, report, resume, air,
            realtime=realtime, unattended=unattended, tip_is_clear=tip_is_clear,
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
    for line in summary["left_out"]:
        click.echo(f"  left out: {line}")
