"""`deltact-fab rig`: list and show benches."""

from __future__ import annotations

from typing import Any

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
    """A rig's settings as they will be used, defaults filled in. No device is opened."""
    from ..rig import config
    from .output import echo_json

    rig_config, path = config.load(name)
    data = rig_config.model_dump(mode="json")
    if as_json:
        echo_json(data)
        return
    click.echo(f"{name} ({path.name}): {data.pop('kind')}")
    _echo(data, "  ")


def _echo(table: dict[str, Any], before: str) -> None:
    for key, value in table.items():
        if isinstance(value, dict):
            _echo(value, f"{before}{key}.")
        else:
            click.echo(f"{before}{key} = {value}")
