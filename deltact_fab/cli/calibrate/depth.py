"""`deltact-fab calibrate depth`: depth in mm from one press of a ball."""

from __future__ import annotations

from pathlib import Path

import click

from ...files import write_whole
from ..options import PATH, out_file
from ..output import Answer, answers


@click.command(epilog="Example: deltact-fab calibrate depth ball-run -o depth.toml")
@click.argument("run", type=PATH)
@click.option("--force", type=PATH, metavar="FILE", show_default="the design's gel",
              help="Calibration of force whose gel is taken, so that a measurement with both is "
              "as fast as with one.")  # fmt: skip
@out_file("Calibration to write.", default=Path("depth.toml"))
@answers
def depth(run: Path, force: Path | None, out: Path) -> Answer:
    """Calibrate depth on RUN, in which a ball of known diameter presses the face.

    It uses the images, the positions of the stage and the diameter of the ball. The protocol
    `ball-press` makes such a run.
    """
    from ...analysis.shape import calibrate_depth

    made = calibrate_depth(run, force)
    write_whole(out, made.toml().encode())
    return Answer({**made.as_dict(), "file": str(out)}, [made.line, f"written: {out}"])
