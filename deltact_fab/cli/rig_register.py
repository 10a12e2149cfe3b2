"""`deltact-fab rig register`: find where the face lies, and keep it in a file."""

from __future__ import annotations

import math
from pathlib import Path

import click

from .options import JSON


@click.command("register")
@click.argument("name", metavar="RIG")
@click.option("--indenter", default="sphere:10", show_default=True, help="A ball, mounted.")
@click.option("--by", type=click.Choice(["force", "hand"]), help="Default: the rig file's.")
@click.option("--at", "at", multiple=True, metavar="X,Y", help="Place on the face, mm; 3 or more.")
@click.option("--jig", is_flag=True, help="Place and turn too, by the sides of [touch.jig].")
@click.option("--design", default="deltact", show_default=True, help="Design of the sensor.")
@click.option("--tip-is-clear", is_flag=True, help="You say that the tip touches nothing: home.")
@click.option("-o", "--output", "out", required=True, type=click.Path(path_type=Path),
              help="File to write, .toml.")  # fmt: skip
@JSON
def register(
    name: str,
    indenter: str,
    by: str | None,
    at: tuple[str, ...],
    jig: bool,
    design: str,
    tip_is_clear: bool,
    out: Path,
    as_json: bool,
) -> None:
    """Find where the face lies by touching it.

    A ball touches it at several places, and its height and tilt are written to a file.
    The rig homes first. Without --at four places are touched, so that the file says how far from
    one plane they lie. With --jig the ball then touches the sides of a block around the sensor,
    which say where the face is sideways and how it is turned. Name the file as `registration` in
    [stage] of the rig file.
    """
    from ..cad.design import load_design
    from ..errors import InputError
    from ..rig import config
    from ..rig.tool import session
    from ..rig.tool.operator import Terminal
    from .output import echo_json

    bench, path = config.load(name)
    if not isinstance(bench, config.GrblConfig):
        raise InputError(f"{path}: kind: only a real rig is registered; this one is {bench.kind!r}")
    if not out.parent.is_dir():
        raise InputError(f"{out.parent}: no such folder")
    places = tuple(_place(text) for text in at)
    asked = session.wanted(bench, path, load_design(design), indenter, places, by, jig)
    operator = Terminal()
    with session.homed(bench, path, operator, tip_is_clear) as devices:
        found = session.register_face(devices, asked, operator)
    session.write(found, path, out)
    if as_json:
        echo_json(
            {
                "file": str(out),
                "origin_machine_mm": list(found.frame.origin_machine_mm),
                "angle_deg": found.frame.angle_deg,
                "tilt_deg": list(found.frame.tilt_deg),
                "residual_mm": found.residual_mm,
                "touches": [touch.as_dict() for touch, _ in found.touches],
            }
        )
        return
    click.echo(f"{out}: {found.line()}")


def _place(text: str) -> tuple[float, float]:
    from ..errors import InputError

    try:
        x, y = (float(part) for part in text.split(","))
        if not math.isfinite(x + y):
            raise ValueError
    except ValueError as why:
        raise InputError(f"--at {text!r}: two numbers are needed, as 8,-6") from why
    return x, y
