"""`deltact-fab rig`: list and show benches."""

from __future__ import annotations

import click


@click.group()
def rig() -> None:
    """Benches: list and show."""


@rig.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
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
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def show(name: str, as_json: bool) -> None:
    """A rig's stage, camera and force sensor as they will be used, defaults filled in."""
    from ..rig import config
    from .output import echo_json

    rig_config, path = config.load(name)
    data = rig_config.model_dump(mode="json")
    if as_json:
        echo_json(data)
        return
    click.echo(f"{name} ({path.name}): {data['kind']}")
    for part in ("stage", "camera", "printer", "force", "gel"):
        for key, value in data[part].items():
            click.echo(f"  {part}.{key} = {value}")
