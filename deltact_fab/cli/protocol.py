"""`deltact-fab protocol`: list, check, show."""

from __future__ import annotations

import click


@click.group()
def protocol() -> None:
    """Indentation experiments: check, show, list."""


RIG = click.option("--rig", "rig_name", default="virtual", show_default=True, help="Rig file.")
JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


@protocol.command("list")
@JSON
def list_(as_json: bool) -> None:
    """Protocols that can be named: local ones and shipped ones."""
    from .. import catalog
    from .output import echo_json, echo_table

    names = catalog.names("protocols")
    if as_json:
        echo_json(names)
        return
    rows = [(n, catalog.read(catalog.find("protocols", n)).get("description", "")) for n in names]
    echo_table(("protocol", "description"), rows)


@protocol.command()
@click.argument("name")
@RIG
@JSON
def check(name: str, rig_name: str, as_json: bool) -> None:
    """Every static check of a protocol on a rig; exit 1 when one fails."""
    from ..bench import checks
    from .output import echo_json

    rows = checks(name, rig_name)
    if as_json:
        echo_json([r.as_dict() for r in rows])
    else:
        for row in rows:
            click.echo(row.line() + ("" if row.ok else f"  at {row.where}"))
    raise click.exceptions.Exit(0 if all(r.ok for r in rows) else 1)


@protocol.command()
@click.argument("name")
@RIG
@JSON
def show(name: str, rig_name: str, as_json: bool) -> None:
    """Steps, frames, time and disk of a protocol."""
    from dataclasses import asdict

    from ..bench import show as expand
    from .output import echo_json, echo_table

    steps, estimate = expand(name, rig_name)
    if as_json:
        echo_json({"steps": [asdict(s) for s in steps], "estimate": estimate.as_dict()})
        return
    echo_table(
        ("step", "kind", "x_mm", "y_mm", "z_mm", "feed_mm_min", "frames"),
        [(s.id, s.kind, *s.target_mm, s.feed_mm_min, s.frames) for s in steps],
    )
    minutes, seconds = divmod(round(estimate.seconds), 60)
    click.echo(
        f"\n{estimate.steps} steps, {estimate.presses} presses, {estimate.frames} frames, "
        f"{minutes} min {seconds} s of motion and settling, about {estimate.disk_mb:.0f} MB"
    )
