"""`deltact-fab doctor`: what is installed, and what is not."""

from __future__ import annotations

import click

from .options import JSON


@click.command()
@click.option("--deep", is_flag=True, help="Also import each package (about 20 s).")
@JSON
def doctor(deep: bool, as_json: bool) -> None:
    """Say what is installed, what each missing thing would bring, and how to get it.

    Looks at Python, the packages of the core and of each extra, system libraries, serial ports,
    cameras, disk and cache. Nothing is opened or changed. Exit code 1 when the core is broken.
    """
    from ..doctor import is_broken, look
    from .output import echo_json

    findings = look(deep)
    broken = is_broken(findings)
    if as_json:
        echo_json({"ok": not broken, "findings": [f.as_dict() for f in findings]})
    else:
        for finding in findings:
            click.echo(finding.line())
        absent = sum(f.state != "ok" for f in findings)
        click.echo(
            f"the core is {'broken' if broken else 'complete'}; {absent} things are not there"
        )
    raise click.exceptions.Exit(1 if broken else 0)
