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
    from dataclasses import asdict

    from ..doctor import is_broken, look
    from .output import echo_result

    findings = look(deep)
    broken = is_broken(findings)
    absent = sum(f.state != "ok" for f in findings)
    verdict = f"the core is {'broken' if broken else 'complete'}; {absent} things are not there"
    data = {"ok": not broken, "findings": [asdict(f) for f in findings]}
    echo_result(data, [*(f.line() for f in findings), verdict], as_json)
    raise click.exceptions.Exit(1 if broken else 0)
