"""`deltact-fab calibrate-depth`: depth in mm from one press of a ball."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("calibrate-depth")
@click.argument("run", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), default="depth.toml",
              show_default=True, help="The calibration to write.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def calibrate_depth(run: Path, output: Path, as_json: bool) -> None:
    """Calibrate the depth on RUN, in which a sphere of known diameter presses the face.

    Takes its images, where the stage had the sphere, and its diameter; the protocol `ball-press`
    makes such a run.
    """
    from ..analysis.shape import calibrate_depth as calibrated
    from ..files import write_whole
    from .output import echo_json

    made = calibrated(run)
    write_whole(output, made.toml().encode())
    if as_json:
        echo_json({**made.as_dict(), "written": str(output)})
        return
    click.echo(made.line)
    click.echo(f"written: {output}")
