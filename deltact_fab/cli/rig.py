"""`deltact-fab rig`: list and show benches, drive a stage, photograph boards on a virtual one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from . import rig_stage
from .options import JSON, SEED, Finite
from .rig_register import register


@click.group()
def rig() -> None:
    """Benches: new, check, list, show, drive by hand, photograph boards."""


for _command in rig_stage.COMMANDS:
    rig.add_command(_command)
rig.add_command(register)


@rig.command("list")
@JSON
def list_(as_json: bool) -> None:
    """Rig files that can be named."""
    from .. import catalog
    from .output import echo_json

    names = catalog.names("protocols/rigs")
    if as_json:
        echo_json(names)
    else:
        click.echo("\n".join(names))


@rig.command()
@click.argument("name")
@JSON
def show(name: str, as_json: bool) -> None:
    """Settings, with the defaults filled in.

    As they will be used; no device is opened.
    """
    from ..rig import config
    from .output import echo_json

    rig_config, path = config.load(name)
    data = rig_config.model_dump(mode="json")
    if as_json:
        echo_json(data)
        return
    click.echo(f"{name} ({path.name}): {data.pop('kind')}")
    _echo(data, "  ")


@rig.command()
@click.argument("name")
@click.option("--board", metavar="skin|NXxNYxMM", help="What lies on a simulated face.")
@click.option("--contact", default=5, show_default=True, help="Images of it; of a skin, one.")
@click.option("--air", default=0, show_default=True, help="Images of a board in the air beyond.")
@click.option("--air-board", metavar="NXxNYxMM", help="That board; default: as --board.")
@click.option("--design", default="deltact", show_default=True, help="Design of the sensor.")
@click.option("--seed", type=SEED, default=0, show_default=True, help="Of places, tilts and noise.")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="A new folder.")
@JSON
def photograph(
    name: str,
    board: str | None,
    contact: int,
    air: int,
    air_board: str | None,
    design: str,
    seed: int,
    out: Path,
    as_json: bool,
) -> None:
    """Photograph boards, to calibrate a camera.

    A real rig's waits for Enter before each of --contact images, if there is a terminal; they go
    to OUT/contact/. On a virtual rig, through its true lens: --board skin is the shipped chessboard
    skin; 9x7x3 is 9 x 7 squares of 3 mm, wetted onto the face. OUT gets contact/, air/, a blank
    frame for the flat field, and truth/.
    """
    import sys

    from ..cad.design import load_design
    from ..errors import InputError
    from ..rig import config
    from ..virtual.photographs import take
    from .calibrate import board_named
    from .output import echo_json

    bench, path = config.load(name)
    if isinstance(bench, config.GrblConfig):
        from ..rig.camera.photograph import photograph as by_camera

        def ask(number: int) -> None:
            if sys.stdin.isatty():
                click.prompt(f"image {number} of {contact}: Enter", "", prompt_suffix="",
                             show_default=False, err=True)  # fmt: skip

        if bench.camera is None:
            raise InputError(f"{path}: camera: missing table; without one there is no image")
        taken = by_camera(bench.camera, path.parent, out, contact, ask)
        if as_json:
            echo_json({"simulated": False, "files": [str(f) for f in taken]})
        else:
            click.echo("\n".join(map(str, taken)))
        return
    if bench.virtual.lens is None:
        raise InputError(f"{path}: a virtual rig with [virtual.lens] is needed, as fisheye")
    if board is None:
        raise click.UsageError("--board: missing; what lies on the face of a virtual rig")
    files = take(
        bench,
        load_design(design),
        board_named(board, "--board"),
        out,
        contact=contact,
        air=air,
        air_board=None if air_board is None else board_named(air_board, "--air-board"),
        seed=seed,
    )
    if as_json:
        echo_json({"simulated": True, "seed": seed, "files": [str(f) for f in files]})
        return
    for file in files:
        click.echo(file)
    click.echo(f"simulated, seed {seed}; the true lens is in {out / 'truth'}")


@rig.command()
@click.argument("file", type=click.Path(path_type=Path))
@JSON
def new(file: Path, as_json: bool) -> None:
    """Write a commented rig file.

    FILE gets the serial ports and cameras that this computer has.
    Nothing is opened, nothing is asked, and no file is overwritten. Then put in what stands under
    MEASURE in it, and look with `rig check FILE`.
    """
    from dataclasses import asdict

    from ..rig.new import new as write
    from .output import echo_json

    found = write(file)
    if as_json:
        echo_json({**asdict(found), "file": str(file)})
        return
    for what, devices in (("port", found.ports), ("camera", found.cameras)):
        for number, device in enumerate(devices):
            use = "used" if number == 0 else "in a comment"
            click.echo(f"{what} {device.name}: {device.text or 'no name'} ({use})")
        if not devices:
            click.echo(f"no {what} was found: an example stands in its place")
    click.echo(f"{file}: written; put in what stands under MEASURE, then `rig check {file}`")


@rig.command()
@click.argument("name", metavar="RIG")
@click.option("--seconds", type=Finite(0.1, 60), default=2.0, show_default=True,
              help="How long devices are watched.")  # fmt: skip
@JSON
def check(name: str, seconds: float, as_json: bool) -> None:
    """Talk to each device, say what is wrong.

    A line for each thing, and how to put it right.
    Nothing moves. Nothing may touch the sensor: its zero is set. Exit 1 when a line says FAIL.
    """
    from ..errors import InputError
    from ..rig import config
    from ..rig.check import check as look
    from .output import echo_json

    bench, path = config.load(name)
    if not isinstance(bench, config.GrblConfig):
        raise InputError(f"{path}: kind: 'virtual' has no device to talk to; a 'grbl' rig is right")
    rows = []
    for row in look(bench, path.parent, seconds):
        rows.append(row)
        if not as_json:
            click.echo(row.line())
    failed = sum(row.verdict == "FAIL" for row in rows)
    if as_json:
        echo_json({"rig": str(path), "ok": not failed, "rows": [row._asdict() for row in rows]})
    else:
        click.echo(f"{path}: {f'{failed} to put right' if failed else 'ready'}")
    raise click.exceptions.Exit(1 if failed else 0)


def _echo(table: dict[str, Any], before: str) -> None:
    for key, value in table.items():
        if isinstance(value, dict):
            _echo(value, f"{before}{key}.")
        else:
            click.echo(f"{before}{key} = {value}")
