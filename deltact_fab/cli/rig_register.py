"""`deltact-fab rig register`: find where the face lies, and keep it in a file."""

from __future__ import annotations

from pathlib import Path

import click

from .options import DESIGN, JSON, RIG_NAME, TIP_IS_CLEAR, Point, out_file


@click.command("register")
@click.argument("name", metavar="RIG", type=RIG_NAME)
@click.option("--indenter", default="sphere:10", show_default=True, metavar="sphere:MM",
              help="The ball that is mounted.")  # fmt: skip
@click.option("--by", type=click.Choice(["force", "hand"]), show_default="as the rig file says",
              help="How a touch is felt.")  # fmt: skip
@click.option("--at", "at", multiple=True, type=Point(), metavar="X,Y",
              help="Where to touch the face, mm; give at least three.")  # fmt: skip
@click.option("--jig", is_flag=True,
              help="Find position and rotation too, from the sides of [touch.jig].")  # fmt: skip
@DESIGN
@TIP_IS_CLEAR
@out_file("Registration to write, .toml.", required=True)
@JSON
def register(
    name: str,
    indenter: str,
    by: str | None,
    at: tuple[tuple[float, float], ...],
    jig: bool,
    design: str,
    tip_is_clear: bool,
    out: Path,
    as_json: bool,
) -> None:
    """Find where the face of the sensor is by touching it with a ball.

    The rig homes, and the ball touches the face at several places; height and tilt of the face are
    written to a file. Without --at it touches four places, so that the file can say how flat they
    are. With --jig the ball then touches the sides of a block around the sensor, which give the
    sideways position of the face and its rotation. Name the file as `registration` under [stage] of
    the rig file.
    """
    from ..cad.design import load_design
    from ..errors import InputError
    from ..rig import config
    from ..rig.tool import session
    from ..rig.tool.operator import TerminalOperator
    from .output import echo_result

    bench, path = config.load(name)
    if not isinstance(bench, config.GrblConfig):
        raise InputError(f"{path}: kind: only a real rig is registered; this one is {bench.kind!r}")
    if not out.parent.is_dir():
        raise InputError(f"{out.parent}: no such folder")
    asked = session.wanted(bench, path, load_design(design), indenter, at, by, jig)
    operator = TerminalOperator()
    with session.homed(bench, path, operator, tip_is_clear) as devices:
        found = session.register_face(devices, asked, operator)
    session.write(found, path, out)
    data = {
        "file": str(out),
        "origin_machine_mm": list(found.frame.origin_machine_mm),
        "angle_deg": found.frame.angle_deg,
        "tilt_deg": list(found.frame.tilt_deg),
        "residual_mm": found.residual_mm,
        "touches": [touch.as_dict() for touch, _ in found.touches],
    }
    echo_result(data, [f"{out}: {found.line()}"], as_json)
